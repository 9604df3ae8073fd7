"""The active-learning loop: plan, act, learn, and make what was learned the next episode's prior."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import ReplayBuffer
from torchrl.envs import EnvBase

from torch_activegp import keys
from torch_activegp.collectors import EpisodeCollector, LargestScoreStart
from torch_activegp.collectors.episode_start import state_space_of
from torch_activegp.errors import CheckpointError, ConfigurationError
from torch_activegp.loops.checkpoint import check_plain, load_checkpoint, save_checkpoint
from torch_activegp.loops.held_out import HeldOutEpisodes
from torch_activegp.loops.measures import largest_variance, mean_discrepancy, probe_points
from torch_activegp.loops.parts import StatefulParts
from torch_activegp.loops.record import EpisodeRecord
from torch_activegp.loops.system import action_space_of, time_step_of
from torch_activegp.models import DynamicsGP, LearnedSimulator

_MISFIT = (LookupError, TypeError, ValueError, AttributeError, RuntimeError)


class ActiveLearning:
    """Learn the dynamics of a system by choosing its experiments.

    Each episode starts where ``start`` says, follows the policy, and updates the GP after every step. The end of the
    episode makes the posterior the next episode's prior (:meth:`DynamicsGP.begin_episode`), refits hyper-parameters if
    ``fit`` is given, and writes a checkpoint.

    An episode happens as a whole or not at all: one that is interrupted or fails leaves the loop as it was before. A
    run that is killed continues bit for bit: build the same objects anew and call :meth:`resume`. The checkpoint holds
    the state of env, policy, GP, start, ``fit``, ``evaluate`` and of the models that the policy plans in, with all
    their generators (:class:`~torch_activegp.loops.parts.StatefulParts`); name anything else in ``stateful``.

    Every episode is a held-out test of the model that it starts with. The ``guard``, a
    :class:`~torch_activegp.loops.HeldOutEpisodes`, keeps the score; :attr:`model` leaves the correction of a state out
    where these tests do not show that it pays.

    Args:
        env: the real system, whose ``"state"`` can be set.
        policy: a planner, or any TensorDict module from ``"state"`` to the environment's action.
        gp: the model to learn; it has a state space.
        episode_length: steps per episode N.
        start: chooses start states, each ``(d,)``. None: the environment's own reset.
        replay_buffer: gets the transitions of each complete episode, also those of a resumed run.
        fit: called with the GP after each episode, e.g. :func:`~torch_activegp.models.fit_hyperparameters`.
        evaluate: called with the loop after each episode; its values enter the record as ``metrics``.
        checkpoint: file to write after each episode.
        settings: plain values that identify the run; a checkpoint with other settings is refused.
        stateful: further generators, or objects with ``state_dict`` and ``load_state_dict``, that a resumed run needs.

    Raises:
        ConfigurationError: the GP has no state space, a setting is not a plain value, ``start`` is an unknown word, or
            collector and default start cannot work with the environment.

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

    def __init__(  # noqa: PLR0913 - everything meets here, and all but three have defaults
        self,
        env: EnvBase,
        policy: Callable[[TensorDictBase], TensorDictBase],
        gp: DynamicsGP,
        *,
        episode_length: int = 10,
        start: Callable[[], Tensor] | Literal["largest variance"] | None = "largest variance",
        replay_buffer: ReplayBuffer | None = None,
        fit: Callable[[DynamicsGP], object] | None = None,
        evaluate: Callable[[ActiveLearning], Mapping[str, float]] | None = None,
        checkpoint: str | Path | None = None,
        settings: Mapping[str, Any] | None = None,
        stateful: Mapping[str, Any] | None = None,
    ) -> None:
        self.env, self.policy, self.gp = env, policy, gp
        self.state_space = state_space_of(gp)
        self.replay_buffer = replay_buffer
        self.fit, self.evaluate = fit, evaluate
        self.collector = EpisodeCollector(env, policy, episode_length, start=self._start(start))
        self.checkpoint = None if checkpoint is None else Path(checkpoint)
        self.settings = {
            "episode_length": episode_length,
            "num_outputs": gp.num_outputs,
            "noise": type(gp.noise_schedule).__name__,
            "recursion": getattr(gp.mean_module, "recursion", None),
            **(settings or {}),
        }
        check_plain(self.settings)
        own = {"gp": gp, "env": env, "policy": policy, "start": self.collector.start, "fit": fit, "evaluate": evaluate}
        further = {f"stateful.{name}": item for name, item in (stateful or {}).items()}
        self._parts = StatefulParts({**own, **further})
        self.records: list[EpisodeRecord] = []
        self.episodes: list[TensorDictBase] = []
        self.guard = HeldOutEpisodes(gp)

    def run(self, num_episodes: int) -> Iterator[EpisodeRecord]:
        """Run until ``num_episodes`` are complete, counting those of a resumed run; yields each new one's record.

        Raises:
            ConfigurationError: ``num_episodes`` is not positive.
            CheckpointError: there is a checkpoint of an earlier run that was not resumed.
        """
        if num_episodes < 1:
            raise ConfigurationError(f"Wanted num_episodes >= 1, found {num_episodes}.")
        if self.checkpoint is not None and self.checkpoint.exists() and not self.records:
            raise CheckpointError(
                f"{self.checkpoint} holds an earlier run. Call resume() to continue it, or choose another file."
            )
        return self._run(num_episodes)

    def resume(self) -> int:
        """Continue from the checkpoint; returns the number of episodes that are complete.

        Raises:
            CheckpointError: no checkpoint was configured, or it is missing, damaged, of other settings, or of other
                objects. The loop is then as it was before.
        """
        if self.checkpoint is None:
            raise CheckpointError("This loop has no checkpoint. Pass checkpoint=... when you make it.")
        content = load_checkpoint(self.checkpoint, self.settings)
        before = self._content()
        try:
            self._restore(content)
        except _MISFIT as error:
            self._restore(before)
            reason = " ".join(str(error).split())
            raise CheckpointError(
                f"{self.checkpoint} does not fit this loop ({reason}). Build env, policy, GP, kernel and start as in "
                "the run that wrote it, or choose another file."
            ) from error
        if self.replay_buffer is not None:
            for episode in self.episodes[len(before["episodes"]) :]:
                self.replay_buffer.extend(episode)
        return len(self.records)

    @property
    def model(self) -> LearnedSimulator:
        """What was learned, as a simulator; without the corrections that held-out episodes do not support.

        It goes on to learn with the GP; its trust in the corrections is that of this moment.
        """
        dt = time_step_of(self.env, self.gp)
        return LearnedSimulator(self.gp, action_space_of(self.env), dt=dt, trust=self.guard.trust())

    def _start(self, start: Callable[[], Tensor] | str | None) -> Callable[[], Tensor] | None:
        if not isinstance(start, str):
            return start
        if start != "largest variance":
            raise ConfigurationError(f"Wanted start='largest variance', a function or None, found {start!r}.")
        return LargestScoreStart(self.gp, action_space_of(self.env))

    def _run(self, num_episodes: int) -> Iterator[EpisodeRecord]:
        while len(self.records) < num_episodes:
            before = self._content()
            try:
                episode = self._run_episode()
            except BaseException:  # a keyboard interrupt, too
                self._restore(before)
                raise
            if self.replay_buffer is not None:
                self.replay_buffer.extend(episode)
            if self.checkpoint is not None:
                save_checkpoint(self.checkpoint, self.settings, self._content())
            yield self.records[-1]

    def _run_episode(self) -> TensorDictBase:
        began = time.perf_counter()
        self.guard.begin()
        episode = self.collector.collect(lambda step: self.gp.update(*self._transitions(step.unsqueeze(0))))
        self.guard.end(*self._transitions(episode))
        self.episodes.append(episode)
        max_variance = largest_variance(self.gp, probe_points(self.gp, action_space_of(self.env)))
        discrepancy = mean_discrepancy(self.gp, *self._transitions(episode))
        self.gp.begin_episode()
        if self.fit is not None:
            self.fit(self.gp)
        metrics = {} if self.evaluate is None else self.evaluate(self)
        record = EpisodeRecord(
            index=len(self.records) + 1,
            num_points=self.gp.num_points,
            max_variance=max_variance,
            discrepancy=discrepancy,
            seconds=time.perf_counter() - began,
            trust=tuple(self.guard.trust().tolist()),
            metrics={name: float(value) for name, value in metrics.items()},
        )
        self.records.append(record)
        return episode

    def _transitions(self, episode: TensorDictBase) -> list[Tensor]:
        return [episode.get(key) for key in (keys.STATE, self.env.action_key, ("next", keys.STATE))]

    def _content(self) -> dict[str, Any]:
        """The loop between two episodes."""
        return {
            "parts": self._parts.state(),
            "records": [record.as_dict() for record in self.records],
            "episodes": [(episode.to_dict(), len(episode)) for episode in self.episodes],
            "guard": list(self.guard.sums),
        }

    def _restore(self, content: Mapping[str, Any]) -> None:
        """Put the loop back; the parts last, so that content of another kind changes nothing."""
        records = [EpisodeRecord.from_dict(values) for values in content["records"]]
        episodes = [TensorDict(values, batch_size=[length]) for values, length in content["episodes"]]
        tests = list(content["guard"])
        self._parts.restore(content["parts"])
        self.records, self.episodes = records, episodes
        self.guard.sums = tests
