"""Planning in the GP: the fast path says what the steps say, and TorchRL can use the environment."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import gpytorch
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor
from torchrl.envs.utils import check_env_specs, step_mdp
from torchrl.modules import CEMPlanner

from torch_activegp import keys
from torch_activegp.acquisition import (
    Box,
    Discrepancy,
    InformationGain,
    SafeSet,
    Spread,
    WeightedSum,
    prior_discrepancy,
)
from torch_activegp.envs import GPEnv, OptimisticTransition
from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP, PosteriorModule
from torch_activegp.planners import ICEMPlanner
from torch_activegp.simulators import ActionSpace, FunctionSimulator, StateSpace

SCORES: dict[str, Callable[[], Any]] = {
    "paper": lambda: prior_discrepancy(0.5),
    "against p0, with a safe set": lambda: WeightedSum(
        [Discrepancy([0.5, 2.0], in_keys=[keys.LOC, keys.SIMULATOR_LOC]), SafeSet(Box([-3.0, -5.0], [3.0, 5.0]))]
    ),
    "information": InformationGain,
}


def actions_for(env: GPEnv, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    spec = env.full_action_spec[env.action_key]
    unit = torch.rand(*shape, spec.shape[-1], generator=generator, dtype=torch.float64)
    return torch.lerp(spec.space.low, spec.space.high, unit)


def states_for(env: GPEnv, shape: tuple[int, ...], generator: torch.Generator) -> TensorDict:
    return TensorDict({"state": env.gp.state_space.sample(shape, generator)}, shape)


def next_action(actions: Iterator[Tensor], td: TensorDict) -> TensorDict:
    return td.set("action", next(actions))


def by_steps(env: GPEnv, start: TensorDict, actions: Tensor) -> tuple[Tensor, Tensor]:
    """Rewards and states of ``env.step``, one after the other, ``(*B, C, H)`` and ``(*B, C, H, d)``."""
    td = start.select("state").unsqueeze(-1).expand(actions.shape[:-2]).clone()
    rewards, states = [], []
    for action in actions.unbind(-2):
        td = env.step(td.set(env.action_key, action))
        rewards.append(td["next", "reward"].squeeze(-1))
        states.append(td["next", "state"])
        td = step_mdp(td, exclude_reward=True)
    return torch.stack(rewards, -1), torch.stack(states, -2)


@pytest.mark.parametrize("score", SCORES)
@pytest.mark.parametrize("transition", [None, OptimisticTransition(0.7)], ids=["mean", "optimistic"])
@pytest.mark.parametrize("clip", [True, False])
def test_imagining_is_stepping(
    any_gp: DynamicsGP, score: str, transition: OptimisticTransition | None, clip: bool, generator: torch.Generator
) -> None:
    env = GPEnv(any_gp, SCORES[score](), transition=transition, clip=clip)
    start = states_for(env, (2,), generator)
    actions = actions_for(env, (2, 4, 6), generator)
    expected, _ = by_steps(env, start, actions)
    rewards = env.imagine(start, actions)
    assert rewards.shape == (2, 4, 6)
    finite = expected.isfinite()
    assert torch.equal(finite, rewards.isfinite())
    assert finite.any()
    torch.testing.assert_close(rewards[finite], expected[finite], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("batch", [(), (1,), (3,), (2, 3)])
@pytest.mark.parametrize("horizon", [1, 5])
def test_batches_of_start_states_and_a_rollout(
    batch: tuple[int, ...], horizon: int, gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    env = GPEnv(gp_with(10), prior_discrepancy())
    start = states_for(env, batch, generator)
    actions = actions_for(env, (*batch, 3, horizon), generator)
    rewards = env.imagine(start, actions)
    assert rewards.shape == (*batch, 3, horizon)
    for candidate, expected in zip(actions.movedim(-3, 0), rewards.movedim(-2, 0), strict=True):
        play = partial(next_action, iter(candidate.unbind(-2)))
        path = env.rollout(horizon, play, tensordict=start.clone(), auto_reset=False)
        torch.testing.assert_close(expected, path["next", "reward"].squeeze(-1), rtol=1e-12, atol=1e-12)


def test_a_score_of_our_own_making_and_one_in_sequence(
    gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    score = TensorDictSequential(
        Spread(), TensorDictModule(lambda s, u: 2 * s - u, in_keys=["spread", "action"], out_keys=["net"])
    )
    env = GPEnv(gp_with(10), score)
    start, actions = states_for(env, (), generator), actions_for(env, (4, 3), generator)
    torch.testing.assert_close(env.imagine(start, actions), by_steps(env, start, actions)[0], rtol=1e-12, atol=1e-12)


def test_the_reward_sees_the_present_state_and_action(
    gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    score = TensorDictModule(lambda x, u: x[..., :1] + 10 * u, in_keys=["state", "action"], out_keys=["score"])
    env = GPEnv(gp_with(10), score)
    start, actions = states_for(env, (5,), generator), actions_for(env, (5, 1, 3), generator)
    rewards, states = by_steps(env, start, actions)
    present = torch.cat([start["state"].unsqueeze(-2), states[:, 0, :-1]], dim=-2)
    expected = present[..., 0] + 10 * actions[:, 0, :, 0]
    assert (states[:, 0, :, 0] - present[..., 0]).abs().max() > 0.01
    torch.testing.assert_close(rewards[:, 0], expected, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(env.imagine(start, actions)[:, 0], expected, rtol=1e-12, atol=1e-12)


def test_the_next_state_is_the_posterior_mean_on_the_circle_and_within_bounds(
    gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    gp = gp_with()
    seen = torch.tensor([[2.6, 7.5]], dtype=torch.float64)
    gp.update(seen, torch.zeros(1, 1), torch.tensor([[-2.4, 9.5]]))  # beyond the seam, and faster than the bound
    env = GPEnv(gp, Spread())
    near = seen + 0.1 * torch.rand(50, 2, generator=generator, dtype=torch.float64)
    points = TensorDict({"state": near, "action": actions_for(env, (50,), generator)}, [50])
    loc = PosteriorModule(gp)(points.clone())["loc"]
    assert (loc[:, 0] > torch.pi).all()
    assert (loc[:, 1] > 8.0).any()
    following = env.step(points.clone())["next", "state"]
    turned = torch.stack([loc[:, 0] - 2 * torch.pi, loc[:, 1]], dim=-1)
    torch.testing.assert_close(following, turned.clamp(max=8.0), rtol=0, atol=1e-13)
    free = GPEnv(gp, Spread(), clip=False).step(points)["next", "state"]
    torch.testing.assert_close(free, turned, rtol=0, atol=1e-13)


def test_a_bound_counts_even_where_others_are_infinite(generator: torch.Generator) -> None:
    space = StateSpace(["free", "bounded"], [-torch.inf, -1.0], [torch.inf, torch.inf])
    drift = FunctionSimulator(lambda x, u: x - 5.0 + 0 * u, space, ActionSpace(["u"], -1.0, 1.0), dt=1.0)
    env = GPEnv(DynamicsGP(SimulatorMean(drift), gpytorch.kernels.RBFKernel()), Spread())
    start = TensorDict({"state": torch.zeros(2, dtype=torch.float64), "action": torch.zeros(1, dtype=torch.float64)})
    assert env.step(start)["next", "state"].tolist() == [-5.0, -1.0]
    with pytest.raises(ConfigurationError, match="wants finite bounds, found infinite ones"):
        env.reset()


def test_the_simulator_is_called_once_a_step(gp_with: Callable[..., DynamicsGP], generator: torch.Generator) -> None:
    gp = gp_with(10)
    gp.begin_episode()
    env = GPEnv(gp, WeightedSum([Discrepancy(), Spread(), SafeSet(Box([-9.0, -9.0], [9.0, 9.0]))]))
    start, actions = states_for(env, (2,), generator), actions_for(env, (2, 5, 7), generator)
    env.imagine(start, actions)
    simulator = gp.mean_module.base_mean.simulator
    before = simulator.calls
    env.imagine(start, actions)
    assert simulator.calls == before + 7
    by_steps(env, start, actions)
    assert simulator.calls == before + 14


def test_a_diverged_candidate_loses_alone(gp_with: Callable[..., DynamicsGP], generator: torch.Generator) -> None:
    env = GPEnv(gp_with(10), prior_discrepancy(), clip=False)
    start, actions = states_for(env, (), generator), actions_for(env, (4, 3), generator)
    expected = env.imagine(start, actions)
    actions[1] = torch.nan
    rewards = env.imagine(start, actions)
    assert rewards[1].isnan().all()
    assert torch.equal(rewards[[0, 2, 3]], expected[[0, 2, 3]])


@pytest.mark.parametrize("num_points", [0, 10])
def test_imagining_leaves_no_trace_in_autograd(
    num_points: int, gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    gp = gp_with(num_points)
    env = GPEnv(gp, prior_discrepancy())
    start, actions = states_for(env, (), generator), actions_for(env, (4, 3), generator).requires_grad_()
    rewards = env.imagine(start, actions)
    assert not rewards.requires_grad
    assert not rewards.is_inference()
    rewards += 1.0
    state = start["state"].requires_grad_()
    points = TensorDict({"state": state, "action": actions[0, 0]})
    PosteriorModule(gp)(points)["loc"].sum().backward()
    assert state.grad.norm() > 0
    assert actions.grad[0, 0].norm() > 0


def test_new_data_change_the_imagination(gp_with: Callable[..., DynamicsGP], generator: torch.Generator) -> None:
    gp = gp_with(10)
    env = GPEnv(gp, Spread())
    start, actions = states_for(env, (), generator), actions_for(env, (1, 1), generator)
    before = env.imagine(start, actions)
    gp.update(start["state"].unsqueeze(0), actions[0], start["state"].unsqueeze(0))
    after = env.imagine(start, actions)
    assert after < 0.05 * before
    torch.testing.assert_close(after, by_steps(env, start, actions)[0], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("transition", [None, OptimisticTransition()], ids=["mean", "optimistic"])
@pytest.mark.parametrize("action_key", ["action", ("agent", "plan")])
@pytest.mark.parametrize("num_points", [0, 5])
def test_specs(
    num_points: int,
    action_key: str | tuple[str, ...],
    transition: OptimisticTransition | None,
    gp_with: Callable[..., DynamicsGP],
    generator: torch.Generator,
) -> None:
    env = GPEnv(gp_with(num_points), prior_discrepancy(), transition=transition, action_key=action_key)
    check_env_specs(env, seed=0)
    spec = env.full_action_spec[action_key]
    assert spec.dtype == torch.float64
    assert spec.space.low.tolist() == [-2.0] + [-1.0] * (2 if transition else 0)
    assert spec.space.high.tolist() == [2.0] + [1.0] * (2 if transition else 0)
    start, actions = states_for(env, (2,), generator), actions_for(env, (2, 3, 4), generator)
    torch.testing.assert_close(env.imagine(start, actions), by_steps(env, start, actions)[0], rtol=1e-12, atol=1e-12)


def test_reset_draws_states_within_the_bounds_from_its_seed(gp_with: Callable[..., DynamicsGP]) -> None:
    env, same, other = (GPEnv(gp_with(), Spread(), seed=seed) for seed in (1, 1, 2))
    before = torch.get_rng_state()
    states = env.reset(TensorDict({}, [500]))["state"]
    assert torch.equal(torch.get_rng_state(), before)
    assert (states.abs() <= env.gp.state_space.high).all()
    assert (states.abs().amax(0) > 0.97 * env.gp.state_space.high).all()
    assert torch.equal(same.reset(TensorDict({}, [500]))["state"], states)
    assert not torch.equal(other.reset(TensorDict({}, [500]))["state"], states)
    env.set_seed(1)
    assert torch.equal(env.reset(TensorDict({}, [500]))["state"], states)
    other.load_state_dict(env.state_dict())
    assert torch.equal(other.reset()["state"], env.reset()["state"])


@pytest.mark.parametrize("batch", [(), (3,)])
def test_reset_starts_where_it_is_told(batch: tuple[int, ...], gp_with: Callable[..., DynamicsGP]) -> None:
    env = GPEnv(gp_with(), Spread())
    start = TensorDict({"state": torch.full((*batch, 2), 0.25)}, batch)
    td = env.reset(start.clone(), set_state=True)
    assert td["state"].dtype == torch.float64
    assert td["state"].eq(0.25).all()
    assert not env.reset(start.clone(), set_state=False)["state"].eq(0.25).any()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # TorchRL's, on an unspecified set_state
        assert env.reset(start.clone())["state"].eq(0.25).all()
    with pytest.raises(ConfigurationError, match="wants a tensordict with 'state', found none"):
        env.reset(TensorDict({}, batch), set_state=True)


def planners(env: GPEnv) -> list[Any]:
    sizes = {"planning_horizon": 4, "optim_steps": 8, "num_candidates": 60, "top_k": 8}
    return [CEMPlanner(env, **sizes), ICEMPlanner(env, **sizes)]


@pytest.mark.parametrize("index", [0, 1], ids=["CEMPlanner", "ICEMPlanner"])
def test_planners_find_the_best_action(
    index: int, gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    score = TensorDictModule(lambda u: -(u - 0.7).square(), in_keys=["action"], out_keys=["score"])
    env = GPEnv(gp_with(10), score)
    with torch.random.fork_rng():
        torch.manual_seed(0)  # CEMPlanner has no generator
        action = planners(env)[index](states_for(env, (3,), generator))["action"]
    torch.testing.assert_close(action, torch.full((3, 1), 0.7, dtype=torch.float64), rtol=0, atol=0.05)


def test_a_planner_prefers_what_is_unknown(gp_with: Callable[..., DynamicsGP], generator: torch.Generator) -> None:
    gp = gp_with()
    start = torch.zeros(40, 2, dtype=torch.float64)
    known = torch.linspace(-2.0, 0.0, 40, dtype=torch.float64).unsqueeze(-1)
    gp.update(start, known, gp.mean_module.base_mean.simulator(start, known))
    planner = ICEMPlanner(GPEnv(gp, Spread()), planning_horizon=1)
    assert planner(TensorDict({"state": start[0]}))["action"].item() > 1.9


def test_the_planner_reaches_through_a_nested_key_and_optimism(
    gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    env = GPEnv(gp_with(10), InformationGain(), transition=OptimisticTransition(), action_key=("agent", "plan"))
    planner = ICEMPlanner(env, planning_horizon=3, optim_steps=2)
    plan = planner(states_for(env, (2,), generator))["agent", "plan"]
    assert plan.shape == (2, 3)
    assert (plan <= env.full_action_spec["agent", "plan"].space.high).all()


def test_the_mean_without_a_simulator_needs_spaces() -> None:
    space = StateSpace(["a", "b"], -1.0, 1.0)
    mean = gpytorch.means.ZeroMean(batch_shape=torch.Size([2]))
    plain = DynamicsGP(mean, gpytorch.kernels.RBFKernel())
    with pytest.raises(ConfigurationError, match="the GP has no state space"):
        GPEnv(plain, Spread(), action_space=ActionSpace(["u"], -1.0, 1.0))
    gp = DynamicsGP(mean, gpytorch.kernels.RBFKernel(), state_space=space)
    with pytest.raises(ConfigurationError, match=r"wraps no simulator, so pass action_space=ActionSpace\(...\)"):
        GPEnv(gp, Spread())
    check_env_specs(GPEnv(gp, Spread(), action_space=ActionSpace(["u"], -1.0, 1.0)))


def test_a_score_that_reads_what_no_posterior_has_is_refused(gp_with: Callable[..., DynamicsGP]) -> None:
    with pytest.raises(ConfigurationError, match=r"wanted a score that reads some of .*, found \['variance'\]"):
        GPEnv(gp_with(), Spread(in_keys=["variance"]))


@pytest.mark.parametrize(
    ("state", "actions"),
    [((2, 2), (3, 5, 4, 1)), ((2,), (5, 4, 2)), ((3,), (5, 4, 1)), ((), (5, 4, 1)), ((2,), (4, 1))],
)
def test_shapes_that_do_not_fit_are_refused(
    state: tuple[int, ...], actions: tuple[int, ...], gp_with: Callable[..., DynamicsGP]
) -> None:
    env = GPEnv(gp_with(), Spread())
    with pytest.raises(ShapeError, match=r"imagine: wanted states \(\*B, 2\) and actions \(\*B, C, H, 1\), found"):
        env.imagine(TensorDict({"state": torch.zeros(state)}), torch.zeros(actions))


def test_float32_starts_and_actions_are_taken_in(
    gp_with: Callable[..., DynamicsGP], generator: torch.Generator
) -> None:
    env = GPEnv(gp_with(10), prior_discrepancy())
    start, actions = states_for(env, (2,), generator).float(), actions_for(env, (2, 3, 4), generator).float()
    rewards = env.imagine(start, actions)
    assert rewards.dtype == torch.float64
    assert torch.equal(rewards, env.imagine(start.double(), actions.double()))
