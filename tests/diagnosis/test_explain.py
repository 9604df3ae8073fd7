from __future__ import annotations

import dataclasses

import mujoco
import pytest

from torch_activegp.diagnosis.explain import _longest, explain
from torch_activegp.diagnosis.numerics import Numerics

NAMES = ("viscous_friction", "coulomb_friction", "constant_force", "actuator_delay")


def some(bench):
    return [effect for effect in bench.effects if effect.name in NAMES]


def test_friction_is_found_with_the_level_of_the_noise(bench) -> None:
    stages: list[str] = []
    found = explain(bench.machine, some(bench), 1, stages.append)
    assert found.selection.best.keys == {("viscous_friction", "joint:hip")}
    assert found.selection.best.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    assert found.shooting.noise.scale[0] == pytest.approx(bench.noise, rel=0.15)
    assert found.effects == tuple(some(bench))
    assert stages[0] == "noise floor"
    assert "naming on all data" in stages


def test_a_coarse_time_step_is_not_taken_for_a_delay(clean) -> None:
    coarse = mujoco.MjModel.from_xml_string(clean.xml.replace("RK4", "Euler").replace("0.005", "0.01"))
    found = explain(dataclasses.replace(clean.machine, model=coarse), some(clean), 1)
    assert found.fine
    assert found.selection.best.effects == ()


def test_nothing_is_found_where_nothing_is_missing(clean) -> None:
    found = explain(clean.machine, some(clean), 1)
    assert found.selection.best.effects == ()
    assert found.selection.nominal.chi2 / found.shooting.dof == pytest.approx(1.0, abs=0.2)


def test_segments_that_cannot_be_shorter_end_the_search(bench, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.explain._SHORTEST", 0.0)
    segments, fit = _longest(bench.machine, Numerics.of(bench.machine, 1), bench.shooting.noise, -1.0)
    assert (segments.scored[:, 1] - segments.scored[:, 0]).max() < 24
    assert len(fit.per_segment) == segments.size
