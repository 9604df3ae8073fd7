"""The guard: on the data that it has seen, simulator + guarded correction is never worse than the simulator alone."""

from __future__ import annotations

import math
import pickle

import pytest
import torch
from gpytorch.kernels import RBFKernel
from torch import Tensor

from torch_activegp.errors import DataError
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import (
    DynamicsGP,
    FixedNoise,
    GuardReport,
    HeldOutGuard,
    InverseSquareNoise,
    LearnedSimulator,
)
from torch_activegp.simulators import LocalBrake, Pendulum

DOUBLE = torch.float64


def test_it_keeps_what_helps_and_drops_what_hurts() -> None:
    base = torch.zeros(4, 3, dtype=DOUBLE)
    target = torch.tensor([1.0, -1.0, 1.0, -1.0], dtype=DOUBLE).unsqueeze(-1).expand(4, 3)
    loc = target * torch.tensor([0.5, -0.5, 4.0], dtype=DOUBLE)  # helps, points the wrong way, is too long
    guard = HeldOutGuard(3, ["a", "b", "c"])
    guard.observe(base, loc, target)
    report = guard.report()
    expected = {
        "simulator_rmse": [1.0, 1.0, 1.0],
        "model_rmse": [0.5, 1.5, 3.0],
        "trust": [1.0, 0.0, 0.25],
        "guarded_rmse": [0.5, 1.0, 0.0],
    }
    for name, values in expected.items():
        torch.testing.assert_close(getattr(report, name), torch.tensor(values, dtype=DOUBLE), rtol=0, atol=1e-12)
    assert report.stepped_in
    assert str(report) == (
        "The guard stepped in: on held-out data the learned model is worse than the simulator alone in "
        "b (1.5 against 1; 0 % of the correction kept), c (3 against 1; 25 % of the correction kept). "
        "Fit the hyper-parameters, or give the kernel shorter length-scales."
    )


def test_it_stays_out_of_the_way_of_a_model_that_helps() -> None:
    guard = HeldOutGuard(1)
    guard.observe(torch.zeros(3, 1), torch.full((3, 1), 0.9), torch.ones(3, 1))
    report = guard.report()
    assert not report.stepped_in
    assert report.trust.tolist() == [1.0]
    assert report.names == ("state 0",)
    assert str(report) == "On held-out data the learned model is better than the simulator alone in every state."


def test_a_model_that_is_better_but_not_trusted_whole_is_called_so() -> None:
    tensors = [torch.tensor([value], dtype=DOUBLE) for value in (1.0, 0.9, 0.95, 0.5)]
    report = GuardReport(*tensors, names=("a",))
    assert report.stepped_in
    assert "the learned model is not reliably better than the simulator alone in a (0.9 against 1; 50 % of" in str(
        report
    )


def test_before_any_data_the_model_is_trusted() -> None:
    report = HeldOutGuard(2).report()
    assert report.trust.tolist() == [1.0, 1.0]
    assert not report.stepped_in
    assert str(report) == "No held-out data tells the learned model from the simulator alone yet."


@pytest.mark.parametrize("seed", range(20))
def test_it_is_never_worse_than_the_simulator(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    guard, errors, base_errors = HeldOutGuard(4), [], []
    parts = []
    for _ in range(3):  # it accumulates
        base, correction, target = torch.randn(3, 7, 4, generator=generator, dtype=DOUBLE)
        correction = correction * 10.0 ** torch.randint(-9, 4, (4,), generator=generator)
        guard.observe(base, base + correction, target)
        parts.append((base, correction, target))
    report = guard.report()
    base, correction, target = (torch.cat(part) for part in zip(*parts, strict=True))
    errors = (base + report.trust * correction - target).square().mean(0).sqrt()
    base_errors = (base - target).square().mean(0).sqrt()
    assert bool((errors <= base_errors * (1 + 1e-12)).all())
    assert bool(((report.trust >= 0) & (report.trust <= 1)).all())
    torch.testing.assert_close(report.guarded_rmse, errors, rtol=1e-7, atol=1e-9)
    torch.testing.assert_close(report.simulator_rmse, base_errors, rtol=1e-12, atol=0)


@pytest.mark.parametrize("name", ["base", "loc", "target"])
def test_predictions_that_are_not_finite(name: str) -> None:
    values = {key: torch.zeros(5, 2) for key in ("base", "loc", "target")}
    values[name][3, 1] = math.nan
    guard = HeldOutGuard(2)
    with pytest.raises(DataError, match=f"NaN or infinity in `{name}`, row 3 of 5"):
        guard.observe(**values)
    assert guard.sums.abs().sum() == 0


def test_state_dict_and_pickle_keep_what_it_saw() -> None:
    guard, fresh = HeldOutGuard(2), HeldOutGuard(2)
    guard.observe(torch.zeros(3, 2), torch.ones(3, 2), torch.full((3, 2), 0.2))
    fresh.load_state_dict(guard.state_dict())
    for other in (fresh, pickle.loads(pickle.dumps(guard))):
        assert torch.equal(other.report().trust, guard.report().trust)


# -- a pendulum whose simulator is right but for a brake --------------------------------------------------------------


def draw(truth: Pendulum, size: int, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    state, action = truth.state_space.sample((size,), generator), truth.action_space.sample((size,), generator)
    return state, action, truth(state, action)


def brake_gp(lengthscale: list[float], noise: float | None) -> DynamicsGP:
    kernel = RBFKernel(ard_num_dims=3).double()
    kernel.lengthscale = torch.tensor([lengthscale], dtype=DOUBLE)
    schedule = InverseSquareNoise() if noise is None else FixedNoise(noise)
    return DynamicsGP(EpisodicMean(SimulatorMean(Pendulum())), kernel, noise=schedule)


@pytest.mark.parametrize("fits", [True, False])
def test_it_steps_in_where_a_wrong_kernel_made_the_model_worse(fits: bool, generator: torch.Generator) -> None:
    """A near-interpolating GP rings around a brake that is narrower than its length-scale."""
    truth = Pendulum(extra_torque=LocalBrake())
    gp = brake_gp([0.35, 1.2, 4.0], 1e-3) if fits else brake_gp([1.0, 3.0, 3.0], None)
    for _ in range(30):
        gp.update(*draw(truth, 10, generator))
        gp.begin_episode()
    guard = HeldOutGuard(2, gp.state_space.names)
    guard.observe_transitions(gp, *draw(truth, 2000, generator))
    report = guard.report()
    assert report.stepped_in is not fits
    assert ("theta_dot (" in str(report)) is not fits
    simulator = Pendulum()
    model = LearnedSimulator(gp, simulator.action_space, simulator.dt, report.trust)
    state, action, next_state = draw(truth, 4000, generator)
    space = truth.state_space
    guarded = space.difference(model(state, action), next_state).square().mean(0).sqrt()
    alone = space.difference(simulator(state, action), next_state).square().mean(0).sqrt()
    assert bool((guarded <= 1.02 * alone).all())  # on fresh data, within its scatter
    if fits:
        assert bool((guarded < 0.5 * alone).all())


def test_angles_are_compared_on_the_circle(gp: DynamicsGP) -> None:
    guard = HeldOutGuard(2)
    state, action = torch.tensor([[math.pi - 0.1, 4.0]], dtype=DOUBLE), torch.zeros(1, 1, dtype=DOUBLE)
    guard.observe_transitions(gp, state, action, Pendulum()(state, action))
    assert guard.report().simulator_rmse[0] < 0.5
