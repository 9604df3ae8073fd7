"""The second set of concealed cases: its machines are those of their files, and its scorer gives what is due."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.unseen.catalogue import SPECS, order
from benchmarks.unseen.check import difference
from benchmarks.unseen.machines import MACHINES
from benchmarks.unseen.score import judge, score

KEY: dict[str, Any] = {
    "case": "case01", "kind": "single", "machine": "door", "verdict": "named", "chi2_per_dof": 9.0, "allowed": [],
    "effects": [{"name": "viscous_friction", "target": "joint:hinge"}],
    "answers": [[["viscous_friction", "joint:hinge"]]],
}  # fmt: skip


def said(verdict: str, *names: str, ties: tuple[str, ...] = ()) -> dict[str, Any]:
    tied = [{"name": name, "target": "joint:hinge"} for name in ties]
    return {"verdict": verdict, "effects": [{"name": n, "target": "joint:hinge", "ties": tied} for n in names]}


@pytest.mark.parametrize("name", MACHINES)
def test_ours_is_the_machine_that_mujoco_reads_from_the_file(name: str) -> None:
    assert difference(MACHINES[name], states=5) < 1e-8


def test_every_machine_and_kind_has_cases_in_an_order_that_the_seed_decides() -> None:
    assert {spec.machine for spec in SPECS} == set(MACHINES)
    assert {spec.kind for spec in SPECS} == {"control", "weak", "single", "two", "three", "retuned", "outside"}
    assert sorted(order(3)) == list(range(len(SPECS))) == sorted(order(4))
    assert list(order(3)) != list(order(4))


@pytest.mark.parametrize(
    ("found", "state"),
    [
        (said("named", "viscous_friction"), "right"),
        (said("tie", "quadratic_drag", ties=("viscous_friction",)), "right"),
        (said("tie", "quadratic_drag", ties=("coulomb_friction",)), "wrong"),
        (said("named", "viscous_friction", "coulomb_friction"), "wrong"),
        (said("unknown"), "unknown"),
        (said("none"), "overlooked"),
        (None, "missing"),
    ],
)
def test_what_was_said_is_judged_by_the_key(found: dict[str, Any] | None, state: str) -> None:
    assert judge(KEY, found) == state


def test_a_name_where_nothing_is_missing_is_wrong() -> None:
    control = {**KEY, "verdict": "none", "effects": []}
    assert judge(control, said("none")) == "right"
    assert judge(control, said("named", "viscous_friction")) == "wrong"


def test_scores_are_counted_by_kind(tmp_path: Path) -> None:
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys" / "case01.json").write_text(json.dumps(KEY))
    (tmp_path / "said" / "case01").mkdir(parents=True)
    (tmp_path / "said" / "case01" / "diagnosis.json").write_text(json.dumps(said("named", "viscous_friction")))
    lines = score(tmp_path, tmp_path / "said").splitlines()
    assert np.array(lines[1].split()[1:], dtype=int).tolist() == [1, 0, 0, 0, 0]
    assert lines[-1].startswith("case01  right")
