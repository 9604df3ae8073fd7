"""The benchmark on real recordings: its own checks give the known figures, and its judges can say no."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def benchmarks_on_path(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(str(ROOT))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "benchmarks"]:
        del sys.modules[name]


def effect(name: str, **values: float) -> dict[str, Any]:
    return {"name": name, "parameters": {key: {"value": value} for key, value in values.items()}, "ties": []}


def held(rows: list[tuple[str, str, bool]]) -> list[bool]:
    return [row[2] for row in rows]


KNOWN_LOSSES = [
    effect("viscous_friction", coefficient=203.5),
    effect("coulomb_friction", level=20.39),
    effect("actuator_bias", bias=3.16 / 35.15),
]


def test_emps_by_inverse_dynamics(recordings_dir: Path) -> None:
    from benchmarks.real import emps

    mass, viscous, coulomb, offset, residual = emps.balance("train")["plain"]
    assert [mass, viscous, coulomb, offset] == pytest.approx([95.11, 203.5, 20.39, -3.16], rel=0.03)
    assert residual < 0.05
    assert emps.balance("train")["directions"][1:3] == pytest.approx([166.7, 240.4], rel=0.02)
    assert emps.force_residual(emps.published()) == pytest.approx(0.0593, abs=5e-4)


def test_the_judge_of_emps_tells_right_from_wrong(recordings_dir: Path) -> None:
    from benchmarks.real import emps

    assert held(emps.judge({"effects": KNOWN_LOSSES})) == [True, True, False, True, True, True]
    directions = [effect("asymmetric_friction", positive=166.7, negative=240.4), KNOWN_LOSSES[1]]
    assert held(emps.judge({"effects": directions})) == [False, True, True, True, True, True]
    two = effect("asymmetric_friction", positive_level=20.39 - 3.16, negative_level=20.39 + 3.16)
    assert held(emps.judge({"effects": [KNOWN_LOSSES[0], two]})) == [False, True, True, True, True, True]
    tied = {**two, "ties": [{"name": "coulomb_friction"}, {"name": "constant_force"}]}
    assert held(emps.judge({"effects": [KNOWN_LOSSES[0], tied]}))[0] is True
    stribeck = effect("stribeck_friction", coulomb=20.0, static=22.0, velocity=0.01)
    assert held(emps.judge({"effects": [*KNOWN_LOSSES, stribeck]}))[1] is False
    wrong = [effect("viscous_friction", coefficient=150.0), *KNOWN_LOSSES[1:]]
    assert held(emps.judge({"effects": wrong})) == [True, True, False, False, False, False]
    assert held(emps.judge({"effects": []}))[:3] == [False, True, False]


def test_multiarm_free_run_of_the_authors_model(recordings_dir: Path, tmp_path: Path) -> None:
    from benchmarks.real import multiarm
    from torch_activegp.data import multiarm_model

    by_file = multiarm.free_run(multiarm.by_mjcf(multiarm_model()))
    assert by_file == pytest.approx(multiarm.free_run(multiarm.by_terms(multiarm.authors())), abs=5e-4)
    names = [effect("coulomb_friction", level=1.0), effect("quadratic_drag", coefficient=1.0)]
    assert held(multiarm.judge({"effects": names}, tmp_path)) == [True, False]
    (tmp_path / "corrected.xml").write_bytes(multiarm_model().read_bytes())
    assert held(multiarm.judge({"effects": names[:1]}, tmp_path)) == [False, True]


def test_laas_cogging_in_its_order(recordings_dir: Path) -> None:
    from benchmarks.real import laas

    periods, _, _, residual = laas.cogging(laas.CUTOFF)[-1]
    assert periods == [72, 18, 12]
    assert residual < 0.16

    def waves(numbers: list[int]) -> dict[str, Any]:
        law = {}
        for end, number in zip(("", "_2", "_3"), numbers, strict=True):
            law |= {f"amplitude{end}": -1.0, f"periods{end}": float(number), f"phase{end}": 0.0}
        return {"effects": [effect("cogging", **law)]}

    assert held(laas.judge_cogging(waves(periods))) == [True, True, False]
    assert held(laas.judge_cogging(waves(periods[::-1])))[:2] == [False, False]
    assert held(laas.judge_cogging({"effects": []})) == [False, False, False]
    assert held(laas.judge_cogging({"effects": [effect("backlash", gap=1.0)]})) == [False, False, False]
    assert held(laas.judge_friction({"effects": [effect("coulomb_friction", level=0.06)]})) == [True]


def test_balls_drag_where_it_can_be_seen(recordings_dir: Path) -> None:
    from benchmarks.real import balls

    drag, error, left = balls.fit("whiffle_ball_1", 1, 2)
    assert drag == pytest.approx(0.046, abs=0.002) and error < 0.002
    assert left < balls.fit("whiffle_ball_1", 1, 0)[2] / 5
    none = {"verdict": "none", "effects": []}
    named = {"verdict": "named", "effects": [effect("quadratic_drag", coefficient=0.05)]}
    assert held(balls.judge({"golf_ball": none, "volleyball": named})) == [True, True]
    assert held(balls.judge({"golf_ball": named, "volleyball": none})) == [False, False]
    both = {"verdict": "named", "effects": [*named["effects"], effect("payload_mass", mass=0.1)]}
    assert held(balls.judge({"volleyball": both})) == [False]
