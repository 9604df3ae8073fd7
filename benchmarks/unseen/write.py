"""Writes cases and keys."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path as Folder
from typing import Any

import numpy as np

from benchmarks.unseen.cases import Case, problems
from benchmarks.unseen.equivalences import corrections, equivalents, normal
from benchmarks.unseen.machine import Machine
from benchmarks.unseen.machines import MACHINES

Array = np.ndarray


def _columns(machine: Machine) -> dict[str, tuple[str, float, bool]]:
    """Canonical name to the file's own name, units per SI unit, and whether it is a whole number."""
    names = ["time", *(f"qpos.{j.name}" for j in machine.joints), *(f"ctrl.{m.name}" for m in machine.motors)]
    found = {name: (name, 1.0, False) for name in names}
    table: dict[str, Any] = tomllib.loads(machine.columns) if machine.columns else {}
    for name in names:
        entry: Any = table
        for part in name.split("."):
            entry = entry.get(part, {})
        if isinstance(entry, str):
            found[name] = (entry, 1.0, False)
        elif entry:
            per = {"ms": 1e3, "deg": 180 / np.pi, "counts": entry.get("counts_per_turn", 0) / (2 * np.pi)}
            found[name] = (entry["column"], per[entry["unit"]], entry["unit"] == "counts")
    return found


def _table(case: Case, run: int, file: Folder) -> None:
    machine = case.machine
    data = np.concatenate([case.path.time[run][:, None], case.readings[run], case.path.control[run]], 1)
    columns = list(_columns(machine).values())
    data = data * [per for _, per, _ in columns]
    shapes = ["%.6f", *["%.9g"] * len(machine.joints), *["%.6f"] * len(machine.motors)]
    shapes = ["%d" if whole else shape for shape, (_, _, whole) in zip(shapes, columns, strict=True)]
    whole = [i for i, (_, _, w) in enumerate(columns) if w]
    data[:, whole] = np.round(data[:, whole])
    header = ",".join(name for name, _, _ in columns)
    np.savetxt(file, data, fmt=",".join(shapes), header=header, comments="")


def _key(case: Case, name: str) -> dict[str, Any]:
    machine = case.machine
    truth = frozenset(normal(machine, e.name, e.target) for e in case.effects)
    verdict = {"control": "none", "outside": "unknown"}.get(case.spec.kind, "named")
    answers = equivalents(machine, truth) if verdict == "named" else set()
    return {
        "case": name,
        "kind": case.spec.kind,
        "machine": machine.name,
        "verdict": verdict,
        "effects": [{"name": e.name, "target": e.target, "parameters": e.params} for e in case.effects],
        "answers": sorted(sorted(a) for a in answers),
        "retuned": {k: {"before": b, "after": a} for k, (b, a) in case.retuned.items()},
        "allowed": sorted(corrections(machine, list(case.retuned))),
        "chi2_per_dof": round(case.chi2, 4),
        "chi2_per_dof_untuned": round(case.chi2_untuned, 4),
        "chi2_per_dof_alone": case.alone,
        "noise": {
            f"qpos.{j.name}": {"kind": n.kind, "std": n.std, "step": n.step, "memory": n.memory}
            for j, n in zip(machine.joints, machine.noise, strict=True)
        },
        "runs": case.plan.kinds,
        "problems": problems(case),
    }


def write(case: Case, out: Folder, name: str) -> list[str]:
    """The folder of the case, and its key apart."""
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    (out / "keys").mkdir(exist_ok=True)
    machine = case.machine
    (folder / "model.xml").write_text(machine.mjcf(case.values))
    if machine.columns:
        (folder / "columns.toml").write_text(machine.columns)
    for run in range(machine.runs):
        _table(case, run, folder / f"run{run + 1}.csv")
    _table(case, machine.runs, folder / "test1.csv")
    key = _key(case, name)
    (out / "keys" / f"{name}.json").write_text(json.dumps(key, indent=1))
    return list(key["problems"])


def readme(out: Folder, seed: int) -> None:
    """What each machine is."""
    lines = [
        "# Unseen machines",
        "",
        f"Made by `python -m benchmarks.unseen make --seed {seed}`. A case is a folder with `model.xml`,",
        "`run*.csv` to fit, `test1.csv` held out, and `columns.toml` where the columns are not canonical;",
        "`keys/` has the truth.",
        "",
        "| machine | joints | rate | runs | seconds | noise (std) | what it is |",
        "|---|---|---|---|---|---|---|",
    ]
    for m in MACHINES.values():
        noise = ", ".join(sorted({f"{n.kind} {n.std:.2g}" for n in m.noise}))
        rate = f"{1 / m.dt:.0f} Hz" + (" irregular" if m.jitter else "")
        lines.append(f"| {m.name} | {len(m.joints)} | {rate} | {m.runs} + 1 | {m.seconds:g} | {noise} | {m.about} |")
    (out / "README.md").write_text("\n".join(lines) + "\n")
