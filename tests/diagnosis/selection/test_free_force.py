from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.free_force import free_force_columns


def test_free_forces_move_the_positions_as_a_simulated_force_does(bench) -> None:
    residual, states, forces = free_force_columns(bench.shooting, bench.nominal, seconds=0.2)
    assert states.shape[-1] == 2
    assert forces.shape[-1] == 3
    np.testing.assert_allclose(residual, bench.segments.position - bench.predict(bench.nominal.candidate))
    strength = 0.02 / bench.engine.model.dof_invweight0[0]
    push = np.zeros((bench.segments.size, bench.segments.intervals, 1))
    push[:, : round(bench.segments.intervals / 3)] = 2 * strength
    pushed = bench.predict(dataclasses.replace(bench.nominal.candidate, force=push))
    moved = pushed - bench.predict(bench.nominal.candidate)
    np.testing.assert_allclose(2 * forces[..., 0], moved, atol=0.02 * np.abs(moved).max())


@pytest.mark.parametrize(("seconds", "bins"), [(0.1, 6), (0.3, 2), (5.0, 1)])
def test_bins_are_about_as_long_as_asked(bench, seconds, bins) -> None:
    assert free_force_columns(bench.shooting, bench.nominal, seconds)[2].shape[-1] == bins


def test_an_offset_is_taken_from_the_measurements(bench) -> None:
    shifted = dataclasses.replace(bench.shooting, offset=np.full_like(bench.segments.position, 0.1))
    plain = free_force_columns(bench.shooting, bench.nominal)[0]
    np.testing.assert_allclose(free_force_columns(shifted, bench.nominal)[0], plain - 0.1)
