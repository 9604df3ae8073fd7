"""The figures of a record, against their definitions."""

from __future__ import annotations

import math
from types import ModuleType

import gpytorch
import pytest
import torch

from torch_activegp.loops.measures import largest_variance, mean_discrepancy, probe_points
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import FunctionSimulator, Pendulum, StateSpace

ACTIONS = Pendulum().action_space


def test_probe_points_fill_the_box_and_stay_the_same(small_run: ModuleType) -> None:
    gp = small_run.make_gp()
    z = probe_points(gp, ACTIONS)
    high = torch.tensor([math.pi, 8.0, 2.0], dtype=torch.float64)
    assert z.shape == (1024, 3)
    assert (z.abs() <= high).all()
    torch.testing.assert_close(z.mean(0) / high, torch.zeros(3, dtype=torch.float64), atol=0.01, rtol=0)
    torch.testing.assert_close(z.std(0) / high, torch.full((3,), 3**-0.5, dtype=torch.float64), atol=0.01, rtol=0)
    assert torch.equal(z, probe_points(gp, ACTIONS))


def test_without_bounds_the_visited_points_are_probed() -> None:
    space = StateSpace(["position"], [-torch.inf], [torch.inf])
    simulator = FunctionSimulator(lambda state, action: state, space, ACTIONS, dt=0.1)
    gp = DynamicsGP(SimulatorMean(simulator), gpytorch.kernels.RBFKernel())
    gp.update(torch.ones(2, 1), torch.zeros(2, 1), torch.ones(2, 1))
    assert probe_points(gp, ACTIONS) is gp.inputs


def test_the_largest_variance_is_that_of_gpytorch_in_units_of_the_output_scale(generator: torch.Generator) -> None:
    scale = torch.tensor([0.1, 5.0], dtype=torch.float64)
    gp = DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel(), output_scale=scale)
    z = probe_points(gp, ACTIONS, 20)
    assert largest_variance(gp, z) == pytest.approx(1.0, abs=1e-12)
    gp.update(z[:, :2], z[:, 2:], torch.zeros(20, 2))
    near = z + 0.3
    with torch.no_grad():
        wanted = (gp(near).variance.mT / scale.square()).max().item()
    assert 0.0 < wanted < 0.9
    assert largest_variance(gp, near) == pytest.approx(wanted, abs=1e-8)


def test_the_discrepancy_is_the_distance_of_simulator_and_truth_on_the_circle(small_run: ModuleType) -> None:
    gp = small_run.make_gp()
    state = torch.tensor([[3.1, 3.0], [0.3, 0.0]], dtype=torch.float64)
    action = torch.tensor([[1.0], [-2.0]], dtype=torch.float64)
    base = gp.mean_module.base_mean.simulator.step(state, action)
    error = torch.tensor([[0.3, 0.4], [0.0, -2.0]], dtype=torch.float64)
    following = gp.state_space.wrap(base + error)
    assert base[0, 0] < 0 or following[0, 0] < 0  # the first one crosses pi
    assert mean_discrepancy(gp, state, action, following) == pytest.approx((0.5 + 2.0) / 2)
    gp.update(state, action, following)
    assert mean_discrepancy(gp, state, action, following) == pytest.approx(1.25)  # p0 does not learn
