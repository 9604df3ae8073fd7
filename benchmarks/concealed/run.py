"""The diagnosis on a case, from its files alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

LIMIT = 3600.0
"""Longest time for one case, s."""


def run_case(folder: Path, out: Path) -> dict[str, Any]:
    """Diagnose one case through the command line, in one thread; what is done already is read."""
    done = out / "diagnosis.json"
    if not done.exists():
        train, test = sorted(folder.glob("train_*.csv")), sorted(folder.glob("test_*.csv"))
        command = [str(Path(sys.executable).with_name("torch-activegp")), "diagnose", str(folder / "model.xml")]
        command += [*map(str, train), *(part for path in test for part in ("--holdout", str(path)))]
        _call([*command, "--out", str(out), "--seed", "0"], out)
    return dict(json.loads(done.read_text(encoding="utf-8")))


def _call(command: list[str], out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    start = time.monotonic()
    ended = subprocess.run(
        command, env={**os.environ, **threads}, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    (out / "seconds.json").write_text(json.dumps(time.monotonic() - start), encoding="utf-8")
    if ended.returncode != 0:
        raise RuntimeError(f"{out.name}: exit code {ended.returncode}\n{ended.stdout[-2000:]}\n{ended.stderr[-4000:]}")


def attempt(folder: Path, out: Path, way: str = "diagnosis") -> str | None:
    """Run a case in one of the ways; the message of what went wrong, which also stays in the folder, or None."""
    if (out / "diagnosis.json").exists():
        return None
    try:
        if way == "diagnosis":
            run_case(folder, out)
        else:
            from benchmarks.concealed.peers import run_peer

            run_peer(way, folder, out)
    except Exception as error:  # a case that fails is a result
        out.mkdir(parents=True, exist_ok=True)
        (out / "failed.txt").write_text(f"{type(error).__name__}: {error}\n", encoding="utf-8")
        return f"{out.name}: {error}"
    (out / "failed.txt").unlink(missing_ok=True)
    return None
