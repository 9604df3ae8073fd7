"""LargestScoreStart finds the true maximum, breaks ties by chance, and never starts where the score is not a number."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import gpytorch
import pytest
import torch
from tensordict.nn import TensorDictModule
from torch import Tensor

from torch_activegp import keys
from torch_activegp.collectors import LargestScoreStart
from torch_activegp.errors import ConfigurationError, PlanningError
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import ActionSpace, FunctionSimulator, Pendulum, StateSpace

ACTIONS = Pendulum().action_space


def make_gp(num_points: int = 0, output_scale: Tensor | None = None) -> DynamicsGP:
    """A pendulum model with long length-scales, so that the variance has one clear maximum."""
    kernel = gpytorch.kernels.RBFKernel(ard_num_dims=3)
    gp = DynamicsGP(SimulatorMean(Pendulum(m=0.5)), kernel, output_scale=output_scale)
    kernel.lengthscale = torch.tensor([2.0, 5.0, 3.0])
    if num_points:
        chance = torch.Generator().manual_seed(3)
        state, action = gp.state_space.sample((num_points,), chance), ACTIONS.sample((num_points,), chance)
        gp.update(state, action, Pendulum().step(state, action))
    return gp


def scored(function: Callable[[Tensor, Tensor], Tensor]) -> TensorDictModule:
    return TensorDictModule(function, in_keys=[keys.STATE, keys.ACTION], out_keys=["mine"])


def best_variance(gp: DynamicsGP, state: Tensor) -> float:
    """The largest variance over a fine grid of actions at one state."""
    action = ACTIONS.grid(41)
    return variance(gp, torch.cat([state.expand(len(action), -1), action], dim=-1)).max().item()


@torch.no_grad()
def variance(gp: DynamicsGP, z: Tensor) -> Tensor:
    return gp.posterior.variance(gp.posterior.features(z))[:, 0]


@pytest.mark.parametrize("seed", range(5))
def test_it_finds_the_largest_variance_of_a_fine_grid(seed: int) -> None:
    gp = make_gp(30)
    state, action = gp.state_space.grid(41), ACTIONS.grid(21)
    z = torch.cat([state.repeat_interleave(21, 0), action.repeat(len(state), 1)], dim=-1)
    grid = variance(gp, z)
    assert grid.median() < 0.2 * grid.max()  # a random point would be far off
    found = LargestScoreStart(gp, ACTIONS, seed=seed)()
    assert found.shape == (2,)
    assert best_variance(gp, found) > 0.99 * grid.max()


def test_refinement_finds_more_than_the_sobol_set_alone() -> None:
    gp = make_gp(30)
    rough = [
        best_variance(gp, LargestScoreStart(gp, ACTIONS, num_candidates=16, num_rounds=0, seed=s)()) for s in range(8)
    ]
    fine = [
        best_variance(gp, LargestScoreStart(gp, ACTIONS, num_candidates=16, num_rounds=6, seed=s)()) for s in range(8)
    ]
    assert sum(fine) > 1.05 * sum(rough)
    assert min(fine) > min(rough)


def test_before_the_first_data_chance_decides() -> None:
    gp = make_gp()
    starts = torch.stack([LargestScoreStart(gp, ACTIONS, seed=seed)() for seed in range(40)])
    assert len(starts.unique(dim=0)) == 40
    assert (starts.mean(0).abs() < 0.25 * gp.state_space.high).all()
    assert (starts.std(0) > 0.4 * gp.state_space.high).all()


def test_a_seed_repeats_and_each_call_draws_anew() -> None:
    gp = make_gp()
    first, second = LargestScoreStart(gp, ACTIONS, seed=7), LargestScoreStart(gp, ACTIONS, seed=7)
    a, b = first(), first()
    assert not torch.equal(a, b)
    assert torch.equal(second(), a)
    assert torch.equal(second(), b)


def test_it_leaves_the_global_source_of_chance_alone() -> None:
    start, before = LargestScoreStart(make_gp(), ACTIONS), torch.get_rng_state()
    start()
    assert torch.equal(torch.get_rng_state(), before)


def test_the_default_score_is_the_spread_in_units_of_the_output_scale() -> None:
    gp = make_gp(10, output_scale=torch.tensor([0.1, 3.0]))
    z = torch.cat([gp.state_space.sample((6,), torch.Generator().manual_seed(1)), torch.zeros(6, 1)], dim=-1)
    with torch.no_grad():
        relative = gp.posterior.variance(gp.posterior.features(z)) / gp.output_scale.square()
    torch.testing.assert_close(LargestScoreStart(gp, ACTIONS).evaluate(z).square(), relative.mean(-1).to(z))


def test_a_score_of_ones_own_is_maximised() -> None:
    peak = torch.tensor([1.0, -3.0])
    score = scored(lambda state, action: -((state - peak).square().sum(-1, keepdim=True)) - action.square())
    found = LargestScoreStart(make_gp(), ACTIONS, score=score, num_rounds=8)()
    torch.testing.assert_close(found, peak.double(), atol=0.1, rtol=0)


def test_an_angle_is_found_where_the_circle_closes() -> None:
    score = scored(lambda state, action: -torch.cos(state[..., :1]) - state[..., 1:].square())
    found = LargestScoreStart(make_gp(), ACTIONS, score=score, num_rounds=8)()
    assert found[0].abs() > 3.1
    assert (found >= -torch.pi).all()


@pytest.mark.parametrize("bad", [torch.nan, torch.inf, -torch.inf])
def test_points_whose_score_is_not_finite_are_never_chosen(bad: float) -> None:
    def score(state: Tensor, action: Tensor) -> Tensor:
        speed = state[..., 1:]
        return torch.where(speed > 0.5, bad, speed)

    for seed in range(5):
        found = LargestScoreStart(make_gp(), ACTIONS, score=scored(score), seed=seed)()
        assert 0.3 < found[1] <= 0.5


@pytest.mark.parametrize("bad", [torch.nan, torch.inf, -torch.inf])
def test_no_finite_score_at_all_is_an_error(bad: float) -> None:
    score = scored(lambda state, action: torch.full_like(action, bad))
    with pytest.raises(PlanningError, match="no finite score among 32 points.*widen the safe set"):
        LargestScoreStart(make_gp(), ACTIONS, score=score, num_candidates=32)()


def test_quaternions_are_of_unit_length() -> None:
    names = ["w", "x", "y", "z", "height"]
    space = StateSpace(names, [-1.0] * 5, [1.0] * 5, quaternions=[0])
    simulator = FunctionSimulator(lambda state, action: state, space, ACTIONS, dt=0.1)
    gp = DynamicsGP(SimulatorMean(simulator), gpytorch.kernels.RBFKernel())
    found = LargestScoreStart(gp, ACTIONS)()
    torch.testing.assert_close(found[:4].norm(), torch.tensor(1.0, dtype=torch.float64))


def test_a_saved_state_repeats_the_next_draw() -> None:
    gp = make_gp()
    start = LargestScoreStart(gp, ACTIONS)
    start()
    saved = copy.deepcopy(start.state_dict())
    wanted = start()
    other = LargestScoreStart(gp, ACTIONS, seed=99)
    other.load_state_dict(saved)
    assert torch.equal(other(), wanted)


def test_it_can_be_pickled() -> None:
    start = LargestScoreStart(make_gp(5), ACTIONS)
    twin = pickle.loads(pickle.dumps(start))
    assert torch.equal(twin(), start())


def test_it_owns_nothing_of_the_model() -> None:
    start = LargestScoreStart(make_gp(5), ACTIONS)
    assert list(start.parameters()) == []
    assert list(start.state_dict()) == ["_extra_state"]


def test_infinite_bounds_are_an_error() -> None:
    space = StateSpace(["position"], [-torch.inf], [torch.inf])
    simulator = FunctionSimulator(lambda state, action: state, space, ACTIONS, dt=0.1)
    gp = DynamicsGP(SimulatorMean(simulator), gpytorch.kernels.RBFKernel())
    with pytest.raises(ConfigurationError, match=r"Wanted finite bounds.*low=\[-inf, -2.0\].*start=None"):
        LargestScoreStart(gp, ACTIONS)


def test_a_model_without_a_state_space_is_an_error() -> None:
    gp = DynamicsGP(gpytorch.means.ZeroMean(batch_shape=torch.Size([2])), gpytorch.kernels.RBFKernel())
    with pytest.raises(ConfigurationError, match=r"no state space. Pass DynamicsGP\(..., state_space="):
        LargestScoreStart(gp, ACTIONS)


@pytest.mark.parametrize("name", ["num_candidates", "num_refined"])
def test_sizes_that_make_no_sense_are_an_error(name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"wanted {name} >= 1, found 0"):
        LargestScoreStart(make_gp(), ACTIONS, **{name: 0})


def test_more_refined_points_than_candidates_are_cut() -> None:
    found = LargestScoreStart(make_gp(), ActionSpace(["u"], -1.0, 1.0), num_candidates=2, num_refined=8)()
    assert found.shape == (2,)
