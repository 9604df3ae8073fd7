from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics.play import Hysteresis


def test_hysteresis_is_a_spring_until_it_slips(bench: Any) -> None:
    effect = Hysteresis.at(bench.shoulder, bench.model)
    k, slip, reach = 2.0, 0.1, 0.5
    path = reach * np.sin(np.linspace(0.0, 6 * np.pi, 6001))[None]
    force = effect.path(path, np.array([k, slip]))[0]
    first = path[0] <= slip
    np.testing.assert_allclose(force[: first.argmin()], -k * path[0, : first.argmin()], atol=1e-12)
    assert np.abs(force).max() == pytest.approx(k * slip)
    turn = slice(2000, 4001)
    work = float((0.5 * (force[turn][1:] + force[turn][:-1]) * np.diff(path[0, turn])).sum())
    assert work == pytest.approx(-4 * k * slip * (reach - slip), rel=1e-3)


def test_hysteresis_remembers_the_run_up_to_each_start(bench: Any) -> None:
    effect, rng = Hysteresis.at(bench.shoulder, bench.model), np.random.default_rng(0)
    positions = np.cumsum(0.05 * rng.normal(size=(2, 60)), axis=1)
    starts = np.array([[0, 0], [0, 30], [1, 30], [1, 59]])
    values = np.array([[2.0, 0.1], [2.0, 0.1], [3.0, 0.2], [3.0, 0.1]])
    memory = effect.memory(positions, starts, values)
    for row, (run, at), value in zip(memory, starts, values, strict=True):
        assert -value[0] * row[0] == pytest.approx(effect.path(positions[run : run + 1], value)[0, at])
        assert row[1] == positions[run, at]


def test_hysteresis_in_a_simulation_follows_its_path(bench: Any) -> None:
    effect, values = Hysteresis.at(bench.shoulder, bench.model), np.array([3.0, 0.05])
    states = bench.hooks(effect, values)
    along = effect.path(np.concatenate([[[0.0]], states[None, :-1, 0]], axis=1), values)[0]
    forces = iter(along)

    def before(data: mujoco.MjData) -> None:
        data.qfrc_applied[0] += next(forces)

    np.testing.assert_allclose(bench.run(bench.model, before=before), states, atol=1e-9)
