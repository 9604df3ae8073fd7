"""ICEMPlanner against known optima, the authors' algorithm, and TorchRL's conventions."""

from __future__ import annotations

import copy
import pickle

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import GymEnv, PendulumEnv, Transform, TransformedEnv

from torch_activegp.errors import ConfigurationError, PlanningError, ShapeError
from torch_activegp.planners import ICEMPlanner, Sampling

F64 = torch.float64


def peak(target):
    """A reward whose only maximum is at the action ``target``, whatever the state."""
    return lambda state, action: -(action - torch.as_tensor(target, dtype=F64)).square().sum(-1)


def small(env, seed=0, **kwargs):
    """A planner that takes a moment."""
    settings = {"planning_horizon": 4, "optim_steps": 4, "num_candidates": 20, "top_k": 5, "num_kept": 2} | kwargs
    return ICEMPlanner(env, **settings, generator=torch.Generator().manual_seed(seed))


# Known optima


@pytest.mark.parametrize("return_best", [True, False])
def test_finds_the_optimal_action_of_a_linear_quadratic_problem(return_best, point_mass):
    state = torch.tensor([[0.5, 0.0], [-0.3, 0.4], [0.2, -0.5]], dtype=F64)
    env = point_mass.env(bound=2.0)
    planner = ICEMPlanner(
        env,
        planning_horizon=5,
        optim_steps=20,
        num_candidates=200,
        top_k=20,
        sampling=Sampling(noise_beta=0.5, return_best=return_best),
    )
    found = planner.planning(env.start(state))
    torch.testing.assert_close(found, point_mass.optimum(state, 5), atol=0.01, rtol=0)


@pytest.mark.parametrize("return_best", [True, False])
@pytest.mark.parametrize(("target", "expected"), [(0.3, 0.3), (-0.7, -0.7), (3.0, 1.0), (-1.0, -1.0)])
def test_finds_an_optimum_inside_and_at_the_bound(target, expected, return_best, imagining_env):
    env = imagining_env(peak(target))
    planner = ICEMPlanner(env, planning_horizon=1, sampling=Sampling(return_best=return_best))
    assert planner(env.start([0.0]))["action"].item() == pytest.approx(expected, abs=0.01)


def test_finds_the_higher_of_two_peaks(imagining_env):
    def score(state, action):
        u = action[..., 0]
        return (-(((u - 0.8) / 0.15) ** 2)).exp() + 0.7 * (-(((u + 0.5) / 0.3) ** 2)).exp()

    env = imagining_env(score)
    start = env.start(torch.zeros(50, 1))
    planner = ICEMPlanner(env, planning_horizon=1, num_candidates=100, sampling=Sampling(init_std=1.0))
    found = planner.planning(start)
    assert ((found - 0.8).abs() < 0.02).sum() >= 48  # a planner that stops at the broad peak finds 0 of 50


def test_beats_random_search_and_cem_at_equal_budget(point_mass, vector_env, imagining_env, generator):
    from torchrl.modules.planners import CEMPlanner

    start = torch.tensor([[2.0, -0.5], [-1.5, 1.0], [1.0, 1.0], [-2.0, -1.0]], dtype=F64).repeat(4, 1)
    horizon, steps = 20, 12

    def cost(act):
        state, total = start, torch.zeros(len(start), dtype=F64)
        for _ in range(steps):
            action = act(env.start(state))
            total = total - point_mass.score(state, action)
            state = point_mass.move(state, action)
        return total.mean().item()

    env = point_mass.env(imagining_env)
    many = cost(ICEMPlanner(env, planning_horizon=horizon, optim_steps=10, num_candidates=400).planning)
    env.seen.clear()
    planner = ICEMPlanner(env, planning_horizon=horizon, optim_steps=3, num_candidates=20, top_k=5, num_kept=2)
    ours = cost(planner.planning) - many
    budget = -(-sum(actions.shape[-3] for actions in env.seen) // steps)
    assert budget == 51  # 20 + 16 + 12 candidates, the mean, and from the second step on 2 elites

    def random_search(tensordict):
        actions = 2 * torch.rand((len(start), budget, horizon, 1), generator=generator, dtype=F64) - 1
        best = env.imagine(tensordict, actions).sum(-1).argmax(-1)
        return actions[torch.arange(len(start)), best, 0]

    assert ours < 0.25 * (cost(random_search) - many)
    cem_env = point_mass.env(vector_env)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        for top_k in (2, 3, 5):
            cem = CEMPlanner(cem_env, horizon, 3, -(-budget // 3), top_k)
            assert ours < 0.5 * (cost(cem.planning) - many)


def test_colored_noise_beats_white_noise_where_the_task_is_slow(point_mass):
    env = point_mass.env()
    start = env.start(torch.tensor([2.0, 0.0], dtype=F64).repeat(20, 1))
    returns = {}
    for beta in (0.0, 2.0):
        planner = ICEMPlanner(env, planning_horizon=30, optim_steps=2, sampling=Sampling(noise_beta=beta))
        planner.planning(start)
        best = planner.memory.elites[:, :1]
        returns[beta] = env.imagine(start, best).sum(-1).mean().item()
    assert returns[2.0] > returns[0.0] + 0.05 * abs(returns[0.0])


# Rows


def test_every_row_of_a_batch_finds_its_own_optimum(imagining_env):
    env = imagining_env(lambda state, action: -(action - state).square().sum(-1))
    targets = torch.tensor([[[0.9], [-0.9], [0.1]], [[-0.4], [0.4], [0.0]]], dtype=F64)
    for start in (targets, targets[0], targets[0, 0]):
        found = ICEMPlanner(env, planning_horizon=2, num_candidates=200)(env.start(start))["action"]
        torch.testing.assert_close(found, start, atol=0.05, rtol=0)


def test_a_row_does_not_depend_on_the_others(imagining_env):
    env = imagining_env(lambda state, action: -(action - state).square().sum(-1))
    alone = small(env).planning(env.start([[0.5], [-0.5]]))
    other = small(env).planning(env.start([[0.5], [0.9]]))
    assert torch.equal(alone[0], other[0]) and not torch.equal(alone[1], other[1])


# The authors' algorithm


def test_population_decays_and_mean_and_elites_join_as_in_the_paper(imagining_env):
    env = imagining_env(peak([0.3, -0.2]), action_dim=2)
    planner = ICEMPlanner(env, planning_horizon=6, num_candidates=50, top_k=10, num_kept=5)
    planner(env.start([0.0]))
    assert [actions.shape[-3] for actions in env.seen] == [50, 40, 32, 25, 20, 20, 20, 20, 20, 21]
    remembered = planner.memory.elites
    env.seen.clear()
    planner(env.start([0.0]))
    assert [actions.shape[-3] for actions in env.seen] == [55, 40, 32, 25, 20, 20, 20, 20, 20, 21]
    joined = env.seen[0][-5:]
    assert torch.equal(joined[:, :-1], remembered[:, 1:])
    assert not torch.isclose(joined[:, -1], remembered[:, -1]).any()


def test_first_iteration_has_the_scaled_std_around_the_centre_and_stays_within_bounds(imagining_env):
    env = imagining_env(peak(0.0))
    env.full_action_spec = env._nest("action", Bounded(1.0, 5.0, (1,), dtype=F64))
    planner = small(env, num_candidates=20_000, sampling=Sampling(init_std=0.1), optim_steps=1)
    planner(env.start([0.0]))
    first = env.seen[0][:-1, :, 0]
    torch.testing.assert_close(first.std(0), torch.full((4,), 0.2, dtype=F64), atol=0.01, rtol=0)
    torch.testing.assert_close(first.mean(0), torch.full((4,), 3.0, dtype=F64), atol=0.01, rtol=0)
    torch.testing.assert_close(env.seen[0][-1], torch.full((4, 1), 3.0, dtype=F64))
    wide = small(env, num_candidates=500, sampling=Sampling(init_std=5.0))
    wide(env.start([0.0]))
    drawn = torch.cat(env.seen[1:])
    assert drawn.min() == 1.0 and drawn.max() == 5.0


def test_mean_is_shifted_momentum_holds_it_back_and_the_std_starts_anew(imagining_env):
    env = imagining_env(peak(0.5))
    planner = small(env, num_candidates=4000, optim_steps=1, sampling=Sampling(momentum=0.5, init_std=0.05))
    plan = torch.tensor([[0.0], [0.2], [0.4], [0.6]], dtype=F64)
    planner.memory.store(plan, plan.expand(2, 4, 1))
    planner(env.start([0.0]))
    shifted = torch.tensor([[0.2], [0.4], [0.6], [0.6]], dtype=F64)
    drawn = env.seen[0][:4000]
    torch.testing.assert_close(drawn.mean(0), shifted, atol=0.01, rtol=0)
    torch.testing.assert_close(drawn.std(0), torch.full((4, 1), 0.05, dtype=F64), atol=0.01, rtol=0)
    torch.testing.assert_close(env.seen[0][4000], shifted)  # one iteration is also the last: the mean is added
    pool = env.seen[0]
    best = pool[env.imagine(env.start([0.0]), pool).sum(-1).topk(5).indices].mean(0)
    torch.testing.assert_close(planner.memory.mean, 0.5 * shifted + 0.5 * best)


def test_kept_elites_are_not_evaluated_again_and_never_lost(imagining_env):
    calls = 0

    def best_once(state, action):
        nonlocal calls
        calls += 1
        return -(action[..., 0] - 0.5).abs() - (10.0 if calls > 1 else 0.0)

    env = imagining_env(best_once)
    planner = small(env, planning_horizon=1)
    found = planner.planning(env.start([0.0]))
    first = env.seen[0][:, 0, :]
    assert torch.equal(found, first[(first[:, 0] - 0.5).abs().argmin()])


def test_a_single_elite_plans_without_nan(imagining_env):
    env = imagining_env(peak(0.3))
    planner = ICEMPlanner(env, planning_horizon=2, top_k=1, num_kept=1)
    for _ in range(3):
        assert planner(env.start([0.0]))["action"].item() == pytest.approx(0.3, abs=0.1)
    assert planner.memory.mean.isfinite().all()


def test_best_and_mean_are_what_they_say(imagining_env):
    env = imagining_env(peak(0.3))
    best, mean = (small(env, num_kept=0, sampling=Sampling(return_best=flag)) for flag in (True, False))
    assert torch.equal(mean.planning(env.start([0.0])), mean.memory.mean[0])
    found = best.planning(env.start([0.0]))
    last = env.seen[-1]
    assert torch.equal(found, last[env.imagine(env.start([0.0]), last).sum(-1).argmax(), 0])
    assert torch.equal(mean.memory.mean, best.memory.mean) and not torch.equal(found, best.memory.mean[0])


# Returns that are not finite


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("kind", ["vector_env", "imagining_env"])
def test_a_candidate_without_a_finite_return_is_never_an_elite(bad, kind, request):
    env = request.getfixturevalue(kind)(lambda state, action: action[..., 0].where(action[..., 0] <= 0.2, bad))
    planner = small(env, num_candidates=100)
    start = env.start([[0.0], [1.0]])
    for _ in range(2):
        action = planner(start)["action"]
        assert (action <= 0.2).all() and (action > 0.0).all()
        assert (planner.memory.elites <= 0.2).all()


def test_fewer_finite_candidates_than_elites_are_enough(imagining_env):
    env = imagining_env(lambda state, action: action[..., 0].where(action[..., 0] > 0.9, -torch.inf))
    planner = small(env, planning_horizon=1, num_candidates=60, top_k=30, optim_steps=2)
    action = planner.planning(env.start([0.0]))
    finite = [(actions > 0.9).sum().item() for actions in env.seen]
    assert 0 < finite[0] < 30
    assert action.item() > 0.9 and planner.memory.mean.item() > 0.7


def test_a_row_that_finds_nothing_at_first_searches_on(imagining_env):
    calls = 0

    def closed_at_first(state, action):
        nonlocal calls
        calls += 1
        return peak(0.3)(state, action) + (0.0 if calls > 2 else torch.nan) * state[..., 0]

    env = imagining_env(closed_at_first)
    planner = ICEMPlanner(env, planning_horizon=1)
    found = planner.planning(env.start([[1.0], [0.0]]))
    torch.testing.assert_close(found, torch.full((2, 1), 0.3, dtype=F64), atol=0.02, rtol=0)


def test_no_finite_return_names_rows_and_causes(imagining_env):
    env = imagining_env(lambda state, action: action[..., 0] / (state[..., 0] != 2.0))
    planner = small(env)
    planner(env.start([[1.0], [1.0]]))
    mean = planner.memory.mean
    with pytest.raises(PlanningError, match=r"finite return in rows \[1\].*safe set.*simulator.*NaN"):
        planner(env.start([[1.0], [2.0]]))
    assert planner.memory.mean is mean
    with pytest.raises(PlanningError, match="No candidate has a finite return: "):
        planner(env.start([2.0]))


# Memory


def test_a_warm_start_improves_the_next_plans(point_mass):
    env = point_mass.env()
    start = torch.tensor([2.0, 0.0], dtype=F64).repeat(20, 1)
    costs = []
    for forget in (True, False):
        planner = small(env, planning_horizon=20, num_candidates=12, optim_steps=2, top_k=4)
        state, cost = start, torch.zeros(20, dtype=F64)
        for _ in range(10):
            if forget:
                planner.reset()
            action = planner.planning(env.start(state))
            cost = cost - point_mass.score(state, action)
            state = point_mass.move(state, action)
        costs.append(cost.mean().item())
    assert costs[1] < 0.95 * costs[0]


@pytest.mark.parametrize("key", ["is_init", ("agents", "is_init")])
def test_is_init_forgets_as_if_the_planner_were_new(key, imagining_env):
    env = imagining_env(peak(0.3), group=("agents",) if isinstance(key, tuple) else ())
    start = env.start([[0.0], [0.0]])
    planner, fresh = small(env), small(env)
    planner(start.clone())
    fresh.noise.load_state_dict(planner.noise.state_dict())
    begins = start.clone().set(key, torch.ones(2, 1, dtype=torch.bool))
    assert torch.equal(planner.planning(begins), fresh.planning(start))
    assert planner.memory.fits(torch.Size([2]))


def test_is_init_of_one_row_leaves_the_memory_of_the_others(imagining_env):
    env = imagining_env(peak(0.9))
    planner = small(env, sampling=Sampling(init_std=0.05))
    for _ in range(8):
        planner(env.start([[0.0], [0.0]]))
    remembered = planner.memory.elites
    env.seen.clear()
    planner(env.start([[0.0], [0.0]]).set("is_init", torch.tensor([[True], [False]])))
    first = env.seen[0]
    assert first[0].mean().abs() < 0.05 and first[1].mean() > 0.4
    assert torch.equal(first[1, -2:, :-1], remembered[1, :, 1:])
    assert (first[0, -2:] < 0.2).all()


def test_reset_and_a_new_batch_shape_forget(imagining_env):
    env = imagining_env(peak(0.3))
    planner = small(env)
    planner(env.start([0.0]))
    planner(env.start([[0.0], [0.0]]))
    planner(env.start([[0.0], [0.0]]))
    planner.reset()
    planner(env.start([[0.0], [0.0]]))
    first = [actions.shape[-3] for actions in env.seen[::4]]
    assert first == [20, 20, 22, 20]


# TorchRL


def test_both_paths_give_the_same_actions(point_mass, vector_env, imagining_env):
    slow, fast = (small(point_mass.env(kind)) for kind in (vector_env, imagining_env))
    state = torch.tensor([[1.0, 0.0], [-0.5, 0.3]], dtype=F64)
    for _ in range(4):
        action = slow(slow.env.start(state))["action"]
        assert torch.equal(fast(fast.env.start(state))["action"], action)
        state = point_mass.move(state, action)


def test_the_fast_path_makes_no_rollout(point_mass, imagining_env, monkeypatch):
    env = point_mass.env(imagining_env)
    monkeypatch.setattr(type(env), "rollout", None)
    small(env)(env.start([1.0, 0.0]))


def test_a_transformed_env_is_planned_in_with_its_transforms(imagining_env):
    class Negate(Transform):
        def _apply_transform(self, reward):
            return -reward

    base = imagining_env(lambda state, action: action[..., 0])
    env = TransformedEnv(base, Negate(in_keys=["reward"], out_keys=["reward"]))
    assert small(base)(base.start([0.0]))["action"].item() > 0.2
    assert small(env)(base.start([0.0]))["action"].item() < -0.2


def test_another_reward_key_is_maximised_and_not_ignored(imagining_env):
    env = imagining_env(peak(-1.0), lambda state, action: state + action)
    planner = small(env)
    assert planner(env.start([0.0]))["action"].item() < -0.5
    planner = small(env)
    planner.set_keys(reward=("next", "state"), action=("plan", "first"))
    out = planner(env.start([0.0]))
    assert out["plan", "first"].item() > 0.5 and "action" not in out
    assert planner.out_keys == [("plan", "first")]


@pytest.mark.parametrize("kind", ["vector_env", "imagining_env"])
def test_nested_keys_are_read_from_the_env(kind, request):
    env = request.getfixturevalue(kind)(peak(0.3), group=("agents", "arm"))
    planner = ICEMPlanner(env, planning_horizon=2)
    out = planner(env.start([[0.0], [0.0]]))
    torch.testing.assert_close(out["agents", "arm", "action"], torch.full((2, 1), 0.3, dtype=F64), atol=0.05, rtol=0)
    assert set(out.keys()) == {"agents"}
    assert planner.in_keys == [("agents", "arm", "state")]


def test_rewards_after_done_do_not_count(vector_env):
    # moving up pays more at once but ends the episode; staying pays for the whole horizon
    env = vector_env(lambda state, action: 1.0 + action[..., 0], lambda state, action: state + action, limit=0.5)
    action = small(env, planning_horizon=10, num_candidates=100)(env.start([0.0]))["action"]
    assert action.item() < 0.5


def test_plans_in_torchrls_pendulum_and_balances_it():
    env = PendulumEnv(seed=0)
    planner = ICEMPlanner(env, optim_steps=3, num_candidates=30, top_k=5, num_kept=2)
    start = env.reset().set("th", torch.tensor(0.3)).set("thdot", torch.tensor(0.0))
    path = env.rollout(20, planner, tensordict=start, auto_reset=False)
    assert path["th"][-1].abs() < 0.05 and path["action"].abs().max() <= 2.0
    assert path["action"].dtype == torch.float32


def test_plans_in_a_model_based_env_without_owning_the_model(point_mass):
    from torchrl.envs.model_based import ModelBasedEnvBase
    from torchrl.modules import SafeModule, WorldModelWrapper

    class Model(ModelBasedEnvBase):
        def __init__(self, world_model):
            super().__init__(world_model)
            self.observation_spec = Composite(state=Unbounded((2,)))
            self.state_spec = self.observation_spec.clone()
            self.action_spec = Bounded(-1.0, 1.0, (1,))
            self.reward_spec = Unbounded((1,))

        def _reset(self, tensordict=None, **kwargs):
            return self.observation_spec.zero(() if tensordict is None else tensordict.batch_size)

    class Move(torch.nn.Linear):
        def forward(self, state, action):
            return super().forward(torch.cat([state, action], dim=-1))

    move = Move(3, 2, bias=False)
    with torch.no_grad():
        move.weight.copy_(torch.cat([point_mass.A, point_mass.B], dim=-1))
    reward = SafeModule(lambda state: -state.square().sum(-1, keepdim=True), in_keys=["state"], out_keys=["reward"])
    env = Model(WorldModelWrapper(SafeModule(move, in_keys=["state", "action"], out_keys=["state"]), reward))
    planner = small(env, planning_horizon=10)
    assert planner(TensorDict({"state": torch.tensor([1.0, 0.0])}))["action"].item() < -0.3
    assert list(env.parameters()) and not list(planner.parameters())
    assert set(planner.state_dict()) == {"noise._extra_state", "memory._extra_state"}
    assert not [name for name, _ in planner.named_modules() if name.startswith(("env", "module"))]
    assert move.weight.requires_grad and move.weight.grad is None


# State, chance, devices


def test_same_seed_same_actions_other_seed_other_actions_and_no_global_chance(imagining_env):
    env = imagining_env(peak(0.3))
    before = torch.get_rng_state()
    first, again, other = (small(env, seed=seed).planning(env.start([0.0])) for seed in (0, 0, 1))
    assert torch.equal(first, again) and not torch.equal(first, other)
    assert torch.equal(torch.get_rng_state(), before)


def test_state_dict_continues_bit_for_bit(point_mass, tmp_path):
    env = point_mass.env()
    state = torch.tensor([[1.0, 0.0], [-0.5, 0.3]], dtype=F64)
    planner, restored = small(env), small(env, seed=9)
    planner(env.start(state))
    torch.save(planner.state_dict(), tmp_path / "planner.pt")
    expected = [planner(env.start(state))["action"] for _ in range(3)]
    restored.load_state_dict(torch.load(tmp_path / "planner.pt", weights_only=True))
    assert all(torch.equal(restored(env.start(state))["action"], action) for action in expected)


@pytest.mark.parametrize("copier", [copy.deepcopy, lambda planner: pickle.loads(pickle.dumps(planner))])
def test_copies_continue_bit_for_bit_and_apart(copier):
    env = PendulumEnv(seed=0)
    planner = small(env)
    start = env.reset().expand(2)
    planner(start.clone())
    twin = copier(planner)
    expected = [planner(start.clone())["action"] for _ in range(2)]
    assert all(torch.equal(twin(start.clone())["action"], action) for action in expected)
    assert twin.env is not planner.env and not list(twin.parameters())


def test_to_moves_the_planner_and_leaves_the_model(imagining_env):
    env = imagining_env(peak(0.3))
    env.weight = torch.nn.Parameter(torch.zeros(1, dtype=F64))
    planner = small(env)
    planner(env.start([0.0]))
    planner.to(torch.float32)
    assert planner.memory.mean.dtype == planner.low.dtype == torch.float32
    assert env.weight.dtype == F64
    assert planner.to("meta").device.type == "meta" and planner.action_spec.device.type == "meta"
    assert env.action_spec.device is None or env.action_spec.device.type == "cpu"


# Errors


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"planning_horizon": 0}, "`planning_horizon` must be at least 1, found 0"),
        ({"optim_steps": 0}, "`optim_steps` must be at least 1"),
        ({"top_k": 0, "num_kept": 0}, "`top_k` must be at least 1"),
        ({"top_k": 21}, "`top_k` must not exceed `num_candidates`, found 21 > 20"),
        ({"num_kept": 6}, r"`num_kept` must lie in \[0, top_k = 5\], found 6"),
    ],
)
def test_sizes_out_of_range(kwargs, message, imagining_env):
    with pytest.raises(ConfigurationError, match=message):
        small(imagining_env(peak(0.0)), **kwargs)


def test_an_unbounded_action_needs_bounds(imagining_env):
    env = imagining_env(peak(0.3), bound=0.0)
    with pytest.raises(ConfigurationError, match=r"Give the env a Bounded action spec or pass Sampling\(action_low"):
        small(env)
    planner = small(env, planning_horizon=1, sampling=Sampling(action_low=-1.0, action_high=0.2))
    assert planner(env.start([0.0]))["action"].item() == pytest.approx(0.2)


def test_a_locked_batch_size_is_refused():
    with pytest.raises(ConfigurationError, match="GymEnv is batch-locked. Plan in a model of it"):
        small(GymEnv("Pendulum-v1"))


@pytest.mark.parametrize(("name", "message"), [("action", "plans one action"), ("reward", "maximises one reward")])
def test_several_actions_or_rewards_are_refused(name, message, imagining_env):
    env = imagining_env(peak(0.3))
    spec = Bounded(-1, 1, (1,), dtype=F64)
    setattr(env, f"full_{name}_spec", Composite({name: spec, "other": spec.clone()}))
    with pytest.raises(ConfigurationError, match=f"{message}.*'other'"):
        small(env)


def test_a_wrong_shape_of_imagine_is_refused(imagining_env):
    env = imagining_env(lambda state, action: action)
    with pytest.raises(ShapeError, match=r"must return one reward for each candidate and step, \(20, 4\)"):
        small(env)(env.start([0.0]))
