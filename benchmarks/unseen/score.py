"""Compares what was said with the keys."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path as Folder
from typing import Any

from benchmarks.unseen.equivalences import Atom, normal
from benchmarks.unseen.machine import Machine
from benchmarks.unseen.machines import MACHINES

STATES = ("right", "wrong", "overlooked", "unknown", "missing")


def _said(machine: Machine, effect: dict[str, Any]) -> Atom:
    return normal(machine, str(effect.get("name")), str(effect.get("target")))


def judge(key: dict[str, Any], said: dict[str, Any] | None) -> str:
    """One of STATES; "overlooked" is a verdict of none where something is missing."""
    if said is None:
        return "missing"
    verdict, right = said.get("verdict"), key["verdict"]
    if right != "named":
        return "right" if verdict == right else "unknown" if verdict == "unknown" else "wrong"
    if verdict in ("none", "unknown"):
        return "overlooked" if verdict == "none" else "unknown"
    machine = MACHINES[key["machine"]]
    allowed = {(a, b) for a, b in key["allowed"]}
    choices = []
    for effect in said.get("effects", []):
        ties = effect.get("ties", []) if verdict == "tie" else []
        choices.append({_said(machine, e) for e in (effect, *ties)})
    pool = set().union(*choices) if choices else set()
    main = {_said(machine, e) for e in said.get("effects", [])}
    for answer in ({(a, b) for a, b in names} for names in key["answers"]):
        if verdict == "named" and answer <= main <= answer | allowed:
            return "right"
        if verdict == "tie" and answer <= pool and all(c & (answer | allowed) for c in choices):
            return "right"
    return "wrong"


def _words(effects: list[dict[str, Any]]) -> str:
    return " + ".join(f"{e['name']}@{e['target']}" for e in effects) or "-"


def _told(said: dict[str, Any] | None) -> str:
    if said is None:
        return ""
    ties = [t for e in said.get("effects", []) for t in e.get("ties", [])]
    tail = f" (or {_words(ties)})" if ties and said.get("verdict") == "tie" else ""
    return f"{said.get('verdict')}: {_words(said.get('effects', []))}{tail}"


def score(out: Folder, results: Folder) -> str:
    """A table by kind and a line for every case."""
    counts: dict[str, Counter[str]] = {}
    lines = []
    for file in sorted((out / "keys").glob("*.json")):
        key = json.loads(file.read_text())
        answer = results / key["case"] / "diagnosis.json"
        said = json.loads(answer.read_text()) if answer.exists() else None
        state = judge(key, said)
        counts.setdefault(key["kind"], Counter())[state] += 1
        lines.append(
            f"{key['case']}  {state:10} {key['kind']:8} {key['machine']:10} chi2 {key['chi2_per_dof']:9.2f}  "
            f"{_words(key['effects'])}  |  {_told(said)}"
        )
    table = [f"{'kind':10}" + "".join(f"{s:>11}" for s in STATES)]
    for kind in (*counts, "all"):
        row = counts[kind] if kind in counts else sum(counts.values(), Counter())
        table.append(f"{kind:10}" + "".join(f"{row[s]:11d}" for s in STATES))
    return "\n".join([*table, "", *lines])
