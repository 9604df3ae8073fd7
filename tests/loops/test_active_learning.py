"""ActiveLearning learns, makes each posterior the next prior, and continues bit for bit however it was interrupted."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import gpytorch
import numpy as np
import pytest
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

from torch_activegp.acquisition import InformationGain, prior_discrepancy
from torch_activegp.collectors import LargestScoreStart
from torch_activegp.envs import GPEnv, MujocoGymEnv, OptimisticTransition, SimulatorEnv
from torch_activegp.errors import CheckpointError, ConfigurationError, SimulationError
from torch_activegp.loops import ActiveLearning
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import (
    DynamicsGP,
    FixedNoise,
    InverseSquareNoise,
    LearnedNoise,
    LearnedSimulator,
    NoiseSchedule,
    fit_hyperparameters,
)
from torch_activegp.planners import ICEMPlanner
from torch_activegp.simulators import FunctionSimulator, LocalBrake, Pendulum, StateSpace


def complete(loop: ActiveLearning, num_episodes: int) -> ActiveLearning:
    for _ in loop.run(num_episodes):
        pass
    return loop


def random_policy(seed: int) -> TensorDictModule:
    """Torques by chance; the generator is no part of a module, so a resumed run must name it."""
    generator = torch.Generator().manual_seed(seed)

    def policy(state: Tensor) -> Tensor:
        return 4.0 * torch.rand(1, generator=generator, dtype=state.dtype) - 2.0

    return TensorDictModule(policy, in_keys=["state"], out_keys=["action"])


class Once(TensorDictModuleBase):
    """Raise an error at a certain step, once."""

    def __init__(self, error: BaseException, step: int) -> None:
        super().__init__()
        self.in_keys, self.out_keys = ["action"], ["action"]
        self.error, self.left = error, step

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.left -= 1
        if not self.left:
            raise self.error
        return tensordict


# -- learning -------------------------------------------------------------------------------------------------------


def paper_loop(score: TensorDictModuleBase, mean: gpytorch.means.Mean | None = None) -> ActiveLearning:
    """The pendulum with the printed settings; ``score`` decides how it explores."""
    truth = Pendulum()
    mean = SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0)) if mean is None else mean
    kernel = gpytorch.kernels.RBFKernel()
    gp = DynamicsGP(EpisodicMean(mean), kernel, noise=InverseSquareNoise(), state_space=truth.state_space)
    kernel.lengthscale = 1.0
    optimism = OptimisticTransition() if isinstance(score, InformationGain) else None
    env = GPEnv(gp, score, action_space=truth.action_space, transition=optimism, action_key=("plan", "action"))
    generator = torch.Generator().manual_seed(0)
    planner = ICEMPlanner(
        env, planning_horizon=10, optim_steps=10, num_candidates=50, top_k=10, num_kept=5, generator=generator
    )
    controls = TensorDictModule(lambda plan: plan[..., :1], in_keys=[("plan", "action")], out_keys=["action"])
    return ActiveLearning(SimulatorEnv(truth), TensorDictSequential(planner, controls), gp, evaluate=Grid(truth))


class Grid:
    """Mean squared error and mean variance on a grid of states and actions."""

    def __init__(self, truth: Pendulum) -> None:
        state, action = truth.state_space.grid(15), truth.action_space.grid(5)
        self.z = torch.cat([state.repeat_interleave(5, 0), action.repeat(len(state), 1)], dim=-1)
        self.following = truth.step(self.z[:, :2], self.z[:, 2:])

    @torch.no_grad()
    def __call__(self, loop: ActiveLearning) -> dict[str, float]:
        posterior = loop.gp.posterior
        features = posterior.features(self.z)
        error = loop.gp.state_space.difference(posterior.loc(features), self.following)
        return {"mse": error.square().mean().item(), "variance": posterior.variance(features).mean().item()}


def test_on_the_papers_pendulum_error_and_variance_fall_and_the_prior_pays() -> None:
    ours = complete(paper_loop(prior_discrepancy()), 4).records
    assert [record.index for record in ours] == [1, 2, 3, 4]
    assert [record.num_points for record in ours] == [10, 20, 30, 40]
    errors, variances = ([record.metrics[name] for record in ours] for name in ("mse", "variance"))
    assert errors[3] < 0.9 * errors[0]
    assert all(after < before for before, after in pairwise(variances))
    largest = [record.max_variance for record in ours]
    assert all(after <= before + 1e-12 for before, after in pairwise(largest))
    without = complete(paper_loop(InformationGain(), gpytorch.means.ZeroMean(batch_shape=torch.Size([2]))), 1).records
    assert without[0].metrics["mse"] > 10 * errors[0]


@pytest.mark.parametrize("recursion", ["paper", "bayes"])
def test_the_posterior_becomes_the_next_episodes_prior(
    small_run: ModuleType, recursion: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = small_run.make_loop(recursion=recursion)
    z = torch.linspace(-2, 2, 30, dtype=torch.float64).reshape(10, 3)
    ends: list[Tensor] = []
    begin_episode = loop.gp.begin_episode

    def spy() -> None:
        ends.append(loop.gp.posterior.loc(loop.gp.posterior.features(z)).detach())
        begin_episode()

    monkeypatch.setattr(loop.gp, "begin_episode", spy)
    for index, _ in enumerate(loop.run(3)):
        assert len(ends) == index + 1
        torch.testing.assert_close(loop.gp.mean_module.reference(z), ends[index], rtol=0, atol=1e-12)
        posterior = loop.gp.posterior
        torch.testing.assert_close(posterior.prior_loc(posterior.features(z)), ends[index], rtol=0, atol=1e-12)
    assert (ends[2] - ends[1]).abs().max() > 1e-3


def test_the_model_learns_each_transition_before_the_next_plan(small_run: ModuleType) -> None:
    known: list[int] = []

    class Watch(TensorDictModuleBase):
        in_keys, out_keys = ("action",), ("action",)

        def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
            known.append(loop.gp.num_points)
            return tensordict

    loop = small_run.make_loop(tail=Watch())
    complete(loop, 2)
    assert known == list(range(8))
    episodes = torch.cat(loop.episodes)
    assert torch.equal(loop.gp.inputs, torch.cat([episodes["state"], episodes["action"]], dim=-1))


def test_an_episode_starts_at_the_largest_variance(small_run: ModuleType) -> None:
    gp = small_run.make_gp()
    loop = small_run.make_loop(start="largest variance")
    assert isinstance(loop.collector.start, LargestScoreStart)
    wanted = LargestScoreStart(gp, loop.env.simulator.action_space)()
    complete(loop, 1)
    assert torch.equal(loop.episodes[0]["state"][0], wanted)


def test_fit_gets_the_model_after_the_prior_has_moved_and_before_the_evaluation(small_run: ModuleType) -> None:
    calls: list[tuple[str, int]] = []

    def fit(gp: DynamicsGP) -> None:
        calls.append(("fit", len(gp.mean_module.expansions[-1].centers)))
        gp.covar_module.lengthscale = 2.0

    def evaluate(loop: ActiveLearning) -> dict[str, float]:
        calls.append(("evaluate", loop.gp.num_points))
        assert (loop.gp.covar_module.lengthscale == 2.0).all()
        assert len(loop.episodes) == len(loop.records) + 1
        return {}

    complete(small_run.make_loop(fit=fit, evaluate=evaluate), 2)
    assert calls == [("fit", 4), ("evaluate", 4), ("fit", 8), ("evaluate", 8)]


@pytest.mark.parametrize("value", [0.5, np.float64(0.5), torch.tensor(0.5)], ids=["float", "numpy", "tensor"])
def test_metrics_enter_the_record_as_plain_numbers(small_run: ModuleType, value: Any, tmp_path: Path) -> None:
    loop = small_run.make_loop(evaluate=lambda loop: {"half": value}, checkpoint=tmp_path / "run.pt")
    (record,) = loop.run(1)
    assert record.metrics == {"half": 0.5}
    assert type(record.metrics["half"]) is float
    assert "half 0.5" in str(record)


def test_the_replay_buffer_holds_all_transitions(small_run: ModuleType) -> None:
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(100), batch_size=8)
    loop = complete(small_run.make_loop(replay_buffer=buffer), 2)
    assert len(buffer) == 8
    assert torch.equal(buffer[:]["next", "state"], torch.cat(loop.episodes)["next", "state"])
    assert buffer.sample()["state"].shape == (8, 2)


# -- what was learned -----------------------------------------------------------------------------------------------


def test_the_model_is_a_simulator_with_the_time_step_of_the_system(small_run: ModuleType) -> None:
    loop = complete(small_run.make_loop(), 2)
    model = loop.model
    assert isinstance(model, LearnedSimulator)
    assert model.dt == loop.env.dt == 0.05
    assert model.action_space is loop.env.simulator.action_space
    assert torch.equal(model.trust, loop.guard.trust())
    assert loop.records[-1].trust == tuple(model.trust.tolist())


def brake_loop(seed: int, lengthscale: float | tuple[float, ...]) -> ActiveLearning:
    """A prior that is right but for a brake near 1.2 rad, explored by chance."""
    kernel = gpytorch.kernels.RBFKernel(ard_num_dims=3)
    gp = DynamicsGP(EpisodicMean(SimulatorMean(Pendulum())), kernel, noise=InverseSquareNoise())
    kernel.lengthscale = torch.as_tensor(lengthscale)
    env = SimulatorEnv(Pendulum(extra_torque=LocalBrake(center=1.2)), seed=seed)
    return ActiveLearning(env, random_policy(seed), gp, start=None)


@pytest.fixture(scope="module")
def fresh() -> tuple[Tensor, Tensor, Tensor]:
    """Transitions of 500 trajectories of the same kind that no loop has seen."""
    truth, generator = Pendulum(extra_torque=LocalBrake(center=1.2)), torch.Generator().manual_seed(99)
    first, action = truth.state_space.sample((500,), generator), truth.action_space.sample((500, 10), generator)
    following = truth.rollout(first, action)
    state = torch.cat([first.unsqueeze(1), following[:, :-1]], dim=1)
    return state.flatten(0, 1), action.flatten(0, 1), following.flatten(0, 1)


def errors(loop: ActiveLearning, fresh: tuple[Tensor, Tensor, Tensor]) -> dict[str, Tensor]:
    """Root mean square error of each state on fresh transitions."""
    state, action, following = fresh
    unguarded = LearnedSimulator(loop.gp, Pendulum().action_space, 0.05)
    models = {"simulator": Pendulum(), "unguarded": unguarded, "guarded": loop.model}
    difference = loop.gp.state_space.difference
    with torch.no_grad():
        return {
            name: difference(model.step(state, action), following).square().mean(0).sqrt()
            for name, model in models.items()
        }


def test_under_a_bad_kernel_the_guarded_model_is_not_worse_than_the_simulator(
    fresh: tuple[Tensor, Tensor, Tensor],
) -> None:
    harmed = 0
    for seed in range(6):
        loop = complete(brake_loop(seed, 3.0), 10)
        found = errors(loop, fresh)
        assert (found["guarded"] <= 1.01 * found["simulator"]).all()
        if (found["unguarded"] > 1.2 * found["simulator"]).any():
            harmed += 1
            assert loop.records[-1].guard_stepped_in
            assert "guard stepped in" in str(loop.records[-1])
            assert "The guard stepped in" in str(loop.guard.report())
    assert harmed >= 4  # else there is nothing to guard against


def test_under_a_good_kernel_the_guard_lets_the_correction_pass(fresh: tuple[Tensor, Tensor, Tensor]) -> None:
    loop = complete(brake_loop(0, (0.35, 4.0, 8.0)), 30)
    found = errors(loop, fresh)
    assert not loop.records[-1].guard_stepped_in
    assert torch.equal(found["guarded"], found["unguarded"])
    assert (found["guarded"] < 0.8 * found["simulator"]).all()


# -- interruptions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("recursion", ["paper", "bayes"])
@pytest.mark.parametrize(
    ("noise", "fit"),
    [
        (FixedNoise(1e-3), False),
        (InverseSquareNoise(), False),
        (InverseSquareNoise(), True),
        (LearnedNoise(), True),
    ],
    ids=["fixed", "inverse square", "inverse square, fitted", "learned"],
)
def test_a_resumed_run_continues_bit_for_bit(
    small_run: ModuleType, tmp_path: Path, noise: NoiseSchedule, fit: bool, recursion: str
) -> None:
    def make(checkpoint: Path | None, seed: int = 0) -> tuple[ActiveLearning, TensorDictReplayBuffer]:
        options: dict[str, Any] = {"noise": noise, "recursion": recursion, "checkpoint": checkpoint, "seed": seed}
        if fit:  # six of all points by chance
            chance = torch.Generator().manual_seed(seed)
            options["fit"] = partial(fit_hyperparameters, max_points=6, max_iterations=3, generator=chance)
        buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(100))
        return small_run.make_loop(replay_buffer=buffer, **options), buffer

    straight, whole = make(None)
    complete(straight, 6)
    complete(make(tmp_path / "run.pt")[0], 3)
    resumed, buffer = make(tmp_path / "run.pt", seed=50)  # nothing depends on how the new objects were seeded
    assert resumed.resume() == 3
    assert [record.index for record in resumed.run(6)] == [4, 5, 6]
    assert small_run.outcome(resumed) == small_run.outcome(straight)
    for key, value in whole[:].items(include_nested=True, leaves_only=True):
        if key != "index":
            assert torch.equal(buffer[:][key], value), key


def test_chance_that_nobody_can_find_is_named(small_run: ModuleType, tmp_path: Path) -> None:
    generator = torch.Generator().manual_seed(0)

    def evaluate(loop: ActiveLearning) -> dict[str, float]:
        return {"drawn": torch.rand((), generator=generator).item()}

    def make(**options: Any) -> ActiveLearning:
        generator.manual_seed(0)
        return small_run.make_loop(evaluate=evaluate, checkpoint=tmp_path / "run.pt", **options)

    wanted = [record.metrics["drawn"] for record in complete(make(stateful={"gp": generator}), 4).records]
    for options, same in (({"stateful": {"gp": generator}}, True), ({}, False)):
        (tmp_path / "run.pt").unlink()
        complete(make(**options), 2)
        loop = make(**options)
        loop.resume()
        complete(loop, 4)
        assert ([record.metrics["drawn"] for record in loop.records] == wanted) is same


def test_a_fit_of_many_points_does_not_read_the_global_source_of_chance(small_run: ModuleType) -> None:
    lengths = []
    for seed in (1, 2):
        fit = partial(fit_hyperparameters, max_points=3, max_iterations=3)
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            lengths.append(complete(small_run.make_loop(fit=fit), 2).gp.covar_module.lengthscale.detach())
    assert torch.equal(*lengths)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SimulationError("burst")], ids=["interrupt", "failure"])
@pytest.mark.parametrize("noise", [FixedNoise(1e-3), InverseSquareNoise()], ids=["fixed", "inverse square"])
def test_an_episode_that_fails_leaves_no_trace(
    small_run: ModuleType, tmp_path: Path, error: BaseException, noise: NoiseSchedule
) -> None:
    wanted = small_run.outcome(complete(small_run.make_loop(noise=noise), 4))
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(100))
    options = {"noise": noise, "replay_buffer": buffer, "checkpoint": tmp_path / "run.pt"}
    loop = small_run.make_loop(tail=Once(error, step=11), **options)
    with pytest.raises(type(error)):
        complete(loop, 4)
    assert len(loop.records) == len(loop.episodes) == 2
    assert loop.gp.num_points == len(buffer) == 8
    complete(loop, 4)
    assert small_run.outcome(loop) == wanted
    assert len(buffer) == 16


def test_an_evaluation_that_fails_leaves_no_trace(small_run: ModuleType) -> None:
    calls: list[int] = []

    def evaluate(loop: ActiveLearning) -> dict[str, float]:
        calls.append(0)
        return {"one": 1.0 / (len(calls) - 2)}

    loop = small_run.make_loop(evaluate=evaluate)
    with pytest.raises(ZeroDivisionError):
        complete(loop, 3)
    assert len(loop.records) == len(loop.episodes) == len(loop.guard.sums) == 1
    plain, loop.evaluate = complete(small_run.make_loop(), 3), None
    complete(loop, 3)
    assert loop.gp.inputs.tolist() == plain.gp.inputs.tolist()


@pytest.fixture
def one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("one_thread")
def test_a_killed_process_is_continued_by_another_bit_for_bit(small_run: ModuleType, tmp_path: Path) -> None:
    checkpoint = tmp_path / "run.pt"
    script = Path(__file__).with_name("small_run.py")
    command = [sys.executable, str(script), str(checkpoint), "11"]  # waits in the third step of episode 3
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "waiting\n"
        finally:
            process.kill()
    assert process.returncode == -signal.SIGKILL
    loop = small_run.make_loop(checkpoint=checkpoint, settings={"seed": 0}, tail=small_run.WaitAt(-1), seed=50)
    assert loop.resume() == 2
    assert small_run.outcome(complete(loop, 4)) == small_run.outcome(complete(small_run.make_loop(), 4))


# -- checkpoints that do not fit ------------------------------------------------------------------------------------


@pytest.fixture
def saved(small_run: ModuleType, tmp_path: Path) -> Path:
    path = tmp_path / "run.pt"
    complete(small_run.make_loop(checkpoint=path, settings={"seed": 0}), 2)
    return path


def test_an_existing_checkpoint_is_not_overwritten(small_run: ModuleType, saved: Path) -> None:
    before = saved.read_bytes()
    loop = small_run.make_loop(checkpoint=saved, settings={"seed": 0})
    with pytest.raises(CheckpointError, match=r"run.pt holds an earlier run. Call resume\(\)"):
        loop.run(3)
    assert saved.read_bytes() == before


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"settings": {"seed": 1}}, "seed: 0 there, 1 now"),
        ({"episode_length": 5}, "episode_length: 4 there, 5 now"),
        ({"recursion": "bayes"}, "recursion: 'paper' there, 'bayes' now"),
        ({"noise": FixedNoise(1.0)}, "noise: 'InverseSquareNoise' there, 'FixedNoise' now"),
    ],
)
def test_other_settings_are_refused(small_run: ModuleType, saved: Path, options: dict[str, Any], message: str) -> None:
    loop = small_run.make_loop(**{"checkpoint": saved, "settings": {"seed": 0}, **options})
    with pytest.raises(CheckpointError, match=f"other settings.*{message}"):
        loop.resume()


def test_other_objects_are_refused_and_change_nothing(small_run: ModuleType, saved: Path) -> None:
    before = saved.read_bytes()
    options = {"checkpoint": saved, "settings": {"seed": 0}}
    further = small_run.make_loop(**options, stateful={"more": torch.Generator()})
    with pytest.raises(CheckpointError, match=r"does not fit this loop \(wanted the states of .*'stateful.more'"):
        further.resume()
    loop = small_run.make_loop(**options)
    loop.gp.covar_module.register_parameter("new", torch.nn.Parameter(torch.ones(1)))
    wanted = small_run.outcome(loop)
    with pytest.raises(CheckpointError, match="does not fit this loop.*Missing key.*covar_module.new"):
        loop.resume()
    assert small_run.outcome(loop) == wanted
    assert saved.read_bytes() == before


def test_a_checkpoint_without_its_parts_is_refused(small_run: ModuleType, saved: Path) -> None:
    content = torch.load(saved, weights_only=True)
    del content["guard"]
    torch.save(content, saved)
    loop = small_run.make_loop(checkpoint=saved, settings={"seed": 0})
    with pytest.raises(CheckpointError, match=r"does not fit this loop \('guard'\)"):
        loop.resume()
    assert loop.gp.num_points == 0


def test_a_damaged_checkpoint_is_refused(small_run: ModuleType, saved: Path) -> None:
    saved.write_bytes(saved.read_bytes()[:-100])
    with pytest.raises(CheckpointError, match="not a readable checkpoint"):
        small_run.make_loop(checkpoint=saved, settings={"seed": 0}).resume()


def test_a_missing_checkpoint_is_an_error(small_run: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no checkpoint. Pass checkpoint="):
        small_run.make_loop().resume()
    with pytest.raises(CheckpointError, match="found none. Start without resuming"):
        small_run.make_loop(checkpoint=tmp_path / "run.pt").resume()


def test_a_disk_that_is_full_costs_neither_the_file_nor_the_episode(
    small_run: ModuleType, saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = small_run.make_loop(checkpoint=saved, settings={"seed": 0})
    loop.resume()
    before = saved.read_bytes()

    def fail(*args: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", fail)
        with pytest.raises(CheckpointError, match="No space left"):
            complete(loop, 4)
    assert saved.read_bytes() == before
    assert len(loop.records) == 3
    wanted = small_run.outcome(complete(small_run.make_loop(), 4))
    assert small_run.outcome(complete(loop, 4)) == wanted


# -- arguments ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, -3])
def test_a_number_of_episodes_that_is_not_positive_is_an_error_at_once(small_run: ModuleType, number: int) -> None:
    with pytest.raises(ConfigurationError, match=f"num_episodes >= 1, found {number}"):
        small_run.make_loop().run(number)


def test_a_run_that_is_complete_yields_nothing(small_run: ModuleType) -> None:
    loop = complete(small_run.make_loop(), 2)
    assert list(loop.run(2)) == []
    assert [record.index for record in loop.run(3)] == [3]


def test_an_unknown_start_is_an_error(small_run: ModuleType) -> None:
    with pytest.raises(ConfigurationError, match="start='largest variance', a function or None, found 'anywhere'"):
        small_run.make_loop(start="anywhere")


def test_a_setting_that_cannot_be_compared_is_an_error(small_run: ModuleType) -> None:
    with pytest.raises(ConfigurationError, match=r"settings\['folder'\]"):
        small_run.make_loop(settings={"folder": Path("x")})


def test_a_model_without_a_state_space_is_an_error() -> None:
    gp = DynamicsGP(gpytorch.means.ZeroMean(batch_shape=torch.Size([2])), gpytorch.kernels.RBFKernel())
    with pytest.raises(ConfigurationError, match="no state space"):
        ActiveLearning(SimulatorEnv(Pendulum()), random_policy(0), gp)


def test_a_system_that_diverges_is_named_with_the_point(small_run: ModuleType) -> None:
    pendulum = Pendulum()

    def step(state: Tensor, action: Tensor) -> Tensor:
        return torch.where(state[..., 1:].abs() > 1, torch.nan, pendulum.step(state, action))

    env = SimulatorEnv(FunctionSimulator(step, pendulum.state_space, pendulum.action_space, pendulum.dt))
    loop = ActiveLearning(env, random_policy(0), small_run.make_gp(), start=lambda: torch.tensor([0.0, 2.0]))
    with pytest.raises(SimulationError, match=r"found \[nan, nan\] in step 0 from state \[0.0, 2.0\]"):
        complete(loop, 1)
    assert loop.gp.num_points == 0


@pytest.mark.parametrize("own_start", [True, False], ids=["own start", "reset by chance"])
def test_the_half_cheetah_is_learned_and_resumed(tmp_path: Path, own_start: bool) -> None:
    size = 18
    space = StateSpace([f"x{j}" for j in range(size)], [-torch.inf] * size, [torch.inf] * size)

    def make(seed: int, start: Any = None) -> ActiveLearning:
        env = MujocoGymEnv("HalfCheetah-v5")
        env.set_seed(seed)
        mean = EpisodicMean(gpytorch.means.ZeroMean(batch_shape=torch.Size([size])))
        gp = DynamicsGP(mean, gpytorch.kernels.RBFKernel(), state_space=space)
        policy = TensorDictModule(lambda state: state[..., 3:9].sin(), in_keys=["state"], out_keys=["action"])
        return ActiveLearning(env, policy, gp, start=start, episode_length=3, checkpoint=tmp_path / "run.pt")

    start = partial(torch.zeros, size) if own_start else None
    loop = complete(make(0, start), 2)
    assert [record.num_points for record in loop.records] == [3, 6]
    assert loop.model.dt == pytest.approx(0.05)
    resumed = make(1, start)
    resumed.resume()
    complete(resumed, 3)
    complete(loop, 3)
    assert torch.equal(resumed.gp.inputs, loop.gp.inputs)
    starts = torch.stack([episode["state"][0] for episode in loop.episodes])
    assert len(starts.unique(dim=0)) == (1 if own_start else 3)
    with pytest.raises(ConfigurationError, match="finite bounds.*start=None"):
        make(0, "largest variance")
