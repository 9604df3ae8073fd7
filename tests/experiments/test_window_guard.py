from __future__ import annotations

import math

import gpytorch
import pytest
import torch
from tensordict import TensorDict

from torch_activegp.experiments.window_guard import cut_windows, guard_windows
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP, LearnedSimulator
from torch_activegp.simulators import ActionSpace, FunctionSimulator, StateSpace

SPACES = (StateSpace(["qpos.x"], -math.inf, math.inf), ActionSpace(["ctrl.u"], -1.0, 1.0))


def simulator(drift: float) -> FunctionSimulator:
    return FunctionSimulator(lambda state, action: state + action + drift, *SPACES, dt=0.1)


def learned(drift: float, correction: float) -> LearnedSimulator:
    """A simulator with a drift, and a GP that adds a constant to it near the data."""
    kernel = gpytorch.kernels.RBFKernel().double()
    kernel.lengthscale = 1e3
    gp = DynamicsGP(SimulatorMean(simulator(drift)), kernel)
    state, action = torch.linspace(-1, 1, 5).unsqueeze(-1).double(), torch.zeros(5, 1).double()
    gp.update(state, action, state + drift + correction)
    return LearnedSimulator(gp, SPACES[1], 0.1)


def recorded(count: int = 3, length: int = 6) -> TensorDict:
    """Windows of a machine without drift and without control."""
    state = torch.arange(count).double().reshape(count, 1, 1).expand(count, length, 1) / 10
    return TensorDict(
        {"state": state, "action": torch.zeros(count, length, 1).double(), "next": {"state": state}}, [count, length]
    )


def test_a_correction_that_helps_is_kept_whole() -> None:
    model = learned(drift=0.1, correction=-0.09)
    kept, note = guard_windows(simulator(0.1), model, recorded(), torch.ones(1).double())
    assert kept is model
    rms = math.sqrt(sum(step**2 for step in range(1, 7)) / 6)
    assert note.startswith("Over windows of 0.6 s that were not learned from, simulator + GP has an error of 0.039")
    assert note.endswith(f"the simulator alone {0.1 * rms:.3g}.")


@pytest.mark.parametrize(("correction", "factor"), [(-0.42, 0.25), (-0.21, 0.5), (0.1, 0.0)])
def test_a_correction_that_leads_astray_is_shrunk_to_the_best_share(correction: float, factor: float) -> None:
    model = learned(drift=0.1, correction=correction)
    kept, note = guard_windows(simulator(0.1), model, recorded(), torch.ones(1).double())
    assert kept.trust.tolist() == [factor]
    assert kept.gp is model.gp
    assert note.startswith("The guard stepped in: over windows of 0.6 s")
    assert f"{100 * factor:.0f} % of the correction is kept" in note
    state = torch.zeros(1, 1).double()
    assert kept(state, state).item() == pytest.approx(0.1 + factor * correction, abs=1e-3)


def test_a_model_that_diverges_is_dropped() -> None:
    def move(state: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        following = state + action + 0.1
        return torch.where(following < 5.0, following, torch.nan)

    model = learned(drift=0.1, correction=1.0)
    model.gp.mean_module.simulator = FunctionSimulator(move, *SPACES, dt=0.1)
    kept, note = guard_windows(simulator(0.1), model, recorded(), torch.ones(1).double())
    assert kept.trust.tolist() == [0.0]
    assert "an error of inf, the simulator alone 0.389; 0 % of the correction is kept (0.389)" in note


def test_windows_are_uninterrupted_pieces_of_like_length() -> None:
    run = TensorDict({"state": torch.arange(20).unsqueeze(-1)}, [20])
    rows = torch.zeros(20, dtype=torch.bool)
    rows[[2, 3, 4, 8, 9, 10, 11, 15]] = True  # pieces of 3, 4 and 1
    other = torch.zeros(20, dtype=torch.bool)
    other[5:8] = True
    windows = cut_windows([run, run], [rows, other])
    assert windows["state"].squeeze(-1).tolist() == [[2, 3, 4], [8, 9, 10], [5, 6, 7]]
