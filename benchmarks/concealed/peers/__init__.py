"""What others would do with the same files; each answers in the contract's words."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

WAYS = {"pysindy": "sindy", "regression": "regression", "sysid": "sysid", "gp": "process"}
"""Name on the command line, and the module whose `diagnose(folder)` answers."""


def run_peer(way: str, folder: Path, out: Path) -> None:
    """Write a peer's diagnosis.json for one case."""
    if way not in WAYS:
        raise ValueError(f"{way}: one of {', '.join(WAYS)} wanted.")
    answer = importlib.import_module(f"benchmarks.concealed.peers.{WAYS[way]}").diagnose(folder)
    out.mkdir(parents=True, exist_ok=True)
    (out / "diagnosis.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
