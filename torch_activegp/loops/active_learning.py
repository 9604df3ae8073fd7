"""The active-learning loop: plan, act, learn, and make what was learned the next episode's prior."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import ReplayBuffer
from torchrl.envs import EnvBase

from torch_activegp import keys
from torch_activegp.collectors import EpisodeCollector, LargestScoreStart
from torch_activegp.errors import CheckpointError, ConfigurationError
from torch_activegp.loops.checkpoint import load_checkpoint, save_checkpoint
from torch_activegp.loops.record import EpisodeRecord
from torch_activegp.models import DynamicsGP, HeldOutGuard, LearnedSimulator
from torch_activegp.simulators import ActionSpace

_GUARD_EPISODES = 5


class ActiveLearning:
    """Learn the dynamics of a system by choosing its experiments.

    Each episode starts where ``start`` says, follows the policy, and updates the GP after every step. The end of the
    episode makes the posterior the next episode's prior (:meth:`DynamicsGP.begin_episode`), refits hyper-parameters if
    ``fit`` is given, and writes a checkpoint. A run that is killed continues bit for bit after :meth:`resume`.

    Every transition is a held-out test of the model before it is learned from. These tests feed a
    :class:`~torch_activegp.models.HeldOutGuard` over the last five episodes; :attr:`model` applies it.

    Args:
        env: the real system, whose ``"state"`` can be set.
        policy: a planner, or any TensorDict module from ``"state"`` to the environment's action.
        gp: the model to learn.
        episode_length: steps per episode N.
        start: chooses start states; default the largest predictive variance. None: the environment's own reset.
        replay_buffer: gets the transitions.
        fit: called with the GP after each episode, e.g. :func:`~torch_activegp.models.fit_hyperparameters`.
        evaluate: called with the loop after each episode; its values enter the record as ``metrics``.
        checkpoint: file to write after each episode.
        settings: plain values that identify the run; a checkpoint with other settings is refused.
        stateful: further objects with ``state_dict`` and ``load_state_dict`` whose state a resumed run needs.

    Example:
        >>> import gpytorch
        >>> from torch_activegp.acquisition import Spread
        >>> from torch_activegp.envs import GPEnv, SimulatorEnv
        >>> from torch_activegp.means import SimulatorMean
        >>> from torch_activegp.planners import ICEMPlanner
        >>> from torch_activegp.simulators import Pendulum
        >>> gp = DynamicsGP(SimulatorMean(Pendulum(m=0.5)), gpytorch.kernels.RBFKernel())
        >>> loop = ActiveLearning(SimulatorEnv(Pendulum()), ICEMPlanner(GPEnv(gp, Spread())), gp, episode_length=2)
        >>> [episode.num_points for episode in loop.run(num_episodes=2)]
        [2, 4]

    Reference: Miller et al. 2024 (arXiv 2403.17233), algorithm 1.
    """

    def __init__(
        self,
        env: EnvBase,
        policy: Any,
        gp: DynamicsGP,
        *,
        episode_length: int = 10,
        start: Callable[[], Tensor] | str | None = "largest variance",
        replay_buffer: ReplayBuffer | None = None,
        fit: Callable[[DynamicsGP], object] | None = None,
        evaluate: Callable[[ActiveLearning], dict[str, float]] | None = None,
        checkpoint: str | Path | None = None,
        settings: dict[str, Any] | None = None,
        stateful: dict[str, Any] | None = None,
    ) -> None:
        self.env, self.policy, self.gp = env, policy, gp
        if isinstance(start, str):
            start = LargestScoreStart(gp, action_space_of(env))
        self.collector = EpisodeCollector(env, policy, episode_length, replay_buffer=replay_buffer, start=start)
        self.fit, self.evaluate = fit, evaluate
        self.checkpoint = None if checkpoint is None else Path(checkpoint)
        self.settings = {"episode_length": episode_length, "num_outputs": gp.num_outputs, **(settings or {})}
        candidates = {"gp": gp, "env": env, "policy": policy, "start": start, **(stateful or {})}
        self._stateful = {name: item for name, item in candidates.items() if hasattr(item, "state_dict")}
        self.records: list[EpisodeRecord] = []
        self.episodes: list[TensorDictBase] = []
        self._guards: deque[Tensor] = deque(maxlen=_GUARD_EPISODES)
        self._resumed = False

    @property
    def replay_buffer(self) -> ReplayBuffer | None:
        """The buffer that gets the transitions."""
        return self.collector.replay_buffer

    def run(self, num_episodes: int) -> Iterator[EpisodeRecord]:
        """Run until ``num_episodes`` are complete, counting those of a resumed run; yields each new one's record.

        Raises:
            ConfigurationError: ``num_episodes`` is not positive.
            CheckpointError: there is a checkpoint of an earlier run that was not resumed.
        """
        if num_episodes < 1:
            raise ConfigurationError(f"Wanted num_episodes >= 1, found {num_episodes}.")
        if self.checkpoint is not None and self.checkpoint.exists() and not (self._resumed or self.records):
            raise CheckpointError(
                f"{self.checkpoint} holds an earlier run. Call resume() to continue it, or choose another file."
            )
        while len(self.records) < num_episodes:
            yield self._run_episode()

    def resume(self) -> int:
        """Continue from the checkpoint; returns the number of episodes that are complete.

        Raises:
            CheckpointError: no checkpoint was configured, or it is missing, damaged or of other settings.
        """
        if self.checkpoint is None:
            raise CheckpointError("This loop has no checkpoint. Pass checkpoint=... when you make it.")
        content = load_checkpoint(self.checkpoint, self.settings)
        for name, item in self._stateful.items():
            item.load_state_dict(content["stateful"][name])
        self.records = [EpisodeRecord(**{**r, "trust": tuple(r["trust"])}) for r in content["records"]]
        self.episodes = [TensorDict(nested, batch_size=[n]) for nested, n in content["episodes"]]
        self._guards = deque(content["guards"], maxlen=_GUARD_EPISODES)
        if self.replay_buffer is not None and len(self.replay_buffer) == 0:
            for episode in self.episodes:
                self.replay_buffer.extend(episode)
        self._resumed = True
        return len(self.records)

    @property
    def guard(self) -> HeldOutGuard:
        """How model and simulator did on the last five episodes' steps, each predicted before it was learned."""
        space = self.gp.state_space
        guard = HeldOutGuard(self.gp.num_outputs, None if space is None else space.names)
        if self._guards:
            guard.sums = torch.stack(list(self._guards)).sum(0)
        return guard

    @property
    def model(self) -> LearnedSimulator:
        """What was learned, as a simulator; the guard shrinks corrections that held-out steps do not support."""
        return LearnedSimulator(
            self.gp, action_space_of(self.env), dt=getattr(self.env, "dt", 1.0), trust=self.guard.report().trust
        )

    def _run_episode(self) -> EpisodeRecord:
        began = time.perf_counter()
        guard = HeldOutGuard(self.gp.num_outputs)

        def learn(transition: TensorDictBase) -> None:
            step = [transition.get(key).unsqueeze(0) for key in (keys.STATE, self.env.action_key)]
            following = transition.get(("next", keys.STATE)).unsqueeze(0)
            guard.observe_transitions(self.gp, *step, following)
            self.gp.update(*step, following)

        episode = self.collector.collect(learn)
        self._guards.append(guard.sums)
        self.episodes.append(episode.select(keys.STATE, self.env.action_key, ("next", keys.STATE)))
        max_variance, discrepancy = self._max_variance(), self._discrepancy(self.episodes[-1])
        self.gp.begin_episode()
        if self.fit is not None:
            self.fit(self.gp)
        metrics = {} if self.evaluate is None else dict(self.evaluate(self))
        record = EpisodeRecord(
            index=len(self.records) + 1,
            num_points=self.gp.num_points,
            max_variance=max_variance,
            discrepancy=discrepancy,
            seconds=time.perf_counter() - began,
            trust=tuple(self.guard.report().trust.tolist()),
            metrics=metrics,
        )
        self.records.append(record)
        self._save()
        return record

    def _save(self) -> None:
        if self.checkpoint is None:
            return
        content = {
            "stateful": {name: dict(item.state_dict()) for name, item in self._stateful.items()},
            "records": [record.as_dict() for record in self.records],
            "episodes": [(episode.to_dict(), episode.shape[0]) for episode in self.episodes],
            "guards": list(self._guards),
        }
        save_checkpoint(self.checkpoint, self.settings, content)

    @torch.no_grad()
    def _max_variance(self) -> float:
        """Largest relative variance at the points of a fixed Sobol set, or at the visited points without bounds."""
        posterior = self.gp.posterior
        z = probe_points(self.gp, action_space_of(self.env))
        variance = posterior.variance(posterior.features(z)) / self.gp.output_scale.square()
        return variance.max().item()

    @torch.no_grad()
    def _discrepancy(self, episode: TensorDictBase) -> float:
        z = torch.cat([episode.get(keys.STATE), episode.get(self.env.action_key)], dim=-1).to(self.gp.output_scale)
        following = episode.get(("next", keys.STATE)).to(z)
        base = self.gp.posterior.simulator_loc(z)
        space = self.gp.state_space
        error = following - base if space is None else space.difference(following, base)
        return torch.linalg.vector_norm(error, dim=-1).mean().item()


def action_space_of(env: EnvBase) -> ActionSpace:
    """The bounds of an environment's actions."""
    simulator = getattr(env, "simulator", None)
    if simulator is not None:
        return simulator.action_space
    spec = env.action_spec
    names = [f"action {j}" for j in range(spec.shape[-1])]
    return ActionSpace(names, spec.space.low.double(), spec.space.high.double())


def probe_points(gp: DynamicsGP, action_space: ActionSpace, num_points: int = 1024) -> Tensor:
    """A fixed Sobol set over the box of states and actions; without bounds, the points visited so far."""
    low, high = torch.cat([gp.state_space.low, action_space.low]), torch.cat([gp.state_space.high, action_space.high])
    if not bool(torch.isfinite(high - low).all()):
        return gp.inputs
    sobol = torch.quasirandom.SobolEngine(len(low)).draw(num_points, dtype=torch.float64)
    return torch.lerp(low, high, sobol.to(low))
