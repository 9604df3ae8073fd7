"""The methods that are compared: the paper's, its baselines, and ours, all through the same GP and planner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import torch
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential

from torch_activegp import keys
from torch_activegp.acquisition import DirectedSpread, InformationGain, RandomScore, Spread, prior_discrepancy
from torch_activegp.collectors import LargestErrorReductionStart, LargestScoreStart
from torch_activegp.envs import GPEnv, MeanTransition, OptimisticTransition, SimulatorEnv, Transition
from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.evaluation import GridEvaluation
from torch_activegp.experiments.task import Task
from torch_activegp.loops import ActiveLearning
from torch_activegp.models import DynamicsGP, fit_hyperparameters
from torch_activegp.planners import ICEMPlanner
from torch_activegp.simulators import ActionSpace

_PLAN = ("plan", "action")


@dataclass(frozen=True)
class Method:
    """A way to choose experiments.

    Attributes:
        title: for legends and tables.
        score: makes the acquisition function for a GP and a seed.
        with_prior: whether the simulator is the GP's mean.
        transition: how imagined steps move.
        start: where episodes start: at the largest ``"variance"``, as in the paper, at the largest ``"score"``, or with
            the largest ``"error reduction"``.
    """

    title: str
    score: Callable[[DynamicsGP, int], TensorDictModuleBase]
    with_prior: bool = True
    transition: Transition = field(default_factory=MeanTransition)
    start: Literal["variance", "score", "error reduction"] = "variance"


METHODS: dict[str, Method] = {
    "discrepancy": Method(
        "Discrepancy + spread (paper)", lambda gp, seed: prior_discrepancy(1.0, gp.output_scale.tolist())
    ),
    "opax": Method("OpAx", lambda gp, seed: InformationGain(), with_prior=False, transition=OptimisticTransition()),
    "opax-prior": Method("OpAx with prior", lambda gp, seed: InformationGain(), transition=OptimisticTransition()),
    "sigma": Method("Sigma-greedy", lambda gp, seed: Spread(gp.output_scale)),
    "discrepancy-p0": Method(
        "Discrepancy from p0 + spread, start too",
        lambda gp, seed: prior_discrepancy(1.0, gp.output_scale, keys.SIMULATOR_LOC),
        start="score",
    ),
    "directed": Method("Directed spread (ours)", lambda gp, seed: DirectedSpread(), start="error reduction"),
    "random": Method("Random", lambda gp, seed: RandomScore(torch.Generator().manual_seed(seed))),
}
"""The methods that the command line knows by name; a new one is a new line."""

PAPER_METHODS = ("discrepancy", "opax", "opax-prior", "sigma", "random")
"""The paper's acquisition function and its baselines."""


@dataclass(frozen=True)
class Budget:
    """How long a trial is and how hard the planner tries; defaults are the paper's.

    Attributes:
        episodes: number of episodes.
        episode_length: steps per episode N.
        planning_horizon: actions per plan.
        optim_steps: iterations of iCEM.
        num_candidates: candidates of the first iteration.
        top_k: elites.
        num_kept: elites kept.
    """

    episodes: int = 30
    episode_length: int = 10
    planning_horizon: int = 10
    optim_steps: int = 10
    num_candidates: int = 50
    top_k: int = 10
    num_kept: int = 5

    def __post_init__(self) -> None:
        """Check the numbers that nobody else checks.

        Raises:
            ConfigurationError: a number is not positive.
        """
        for name in ("episodes", "episode_length", "planning_horizon"):
            if getattr(self, name) < 1:
                raise ConfigurationError(f"Wanted {name} >= 1, found {getattr(self, name)}.")


def _planner_settings(budget: Budget) -> dict[str, int]:
    """What a resumed trial must share; it may have more episodes."""
    return {name: value for name, value in asdict(budget).items() if name not in ("episodes", "episode_length")}


def make_loop(
    task: Task, method: str, seed: int, budget: Budget | None = None, *, checkpoint: Path | None = None
) -> ActiveLearning:
    """One trial of a method on a task, ready to run.

    Args:
        task: the system to learn.
        method: a key of :data:`METHODS`.
        seed: of every random draw in the trial.
        budget: default :class:`Budget`.
        checkpoint: file to write after each episode.

    Raises:
        ConfigurationError: unknown method.
    """
    budget = budget or Budget()
    if method not in METHODS:
        raise ConfigurationError(f"Unknown method {method!r}. Choose from: {', '.join(METHODS)}.")
    chosen = METHODS[method]
    gp = task.gp.make(task.prior, with_prior=chosen.with_prior)
    actions = task.truth.action_space
    score = chosen.score(gp, seed)
    model = GPEnv(gp, score, action_space=actions, transition=chosen.transition, action_key=_PLAN)
    planner = ICEMPlanner(
        model,
        planning_horizon=budget.planning_horizon,
        optim_steps=budget.optim_steps,
        num_candidates=budget.num_candidates,
        top_k=budget.top_k,
        num_kept=budget.num_kept,
        generator=torch.Generator().manual_seed(seed),
    )
    controls = TensorDictModule(lambda plan: plan[..., : actions.dim], in_keys=[_PLAN], out_keys=[keys.ACTION])
    return ActiveLearning(
        SimulatorEnv(task.truth, seed=seed),
        TensorDictSequential(planner, controls),
        gp,
        episode_length=budget.episode_length,
        start=_make_start(chosen, gp, actions, score, budget, seed),
        fit=partial(fit_hyperparameters, generator=torch.Generator().manual_seed(seed))
        if task.gp.fitted
        else task.gp.fit,
        evaluate=GridEvaluation(task),
        checkpoint=checkpoint,
        settings={"task": task.name, "method": method, "seed": seed, **_planner_settings(budget)},
        stateful={"score": score},
    )


def _make_start(
    method: Method, gp: DynamicsGP, actions: ActionSpace, score: TensorDictModuleBase, budget: Budget, seed: int
) -> LargestErrorReductionStart | LargestScoreStart:
    if method.start == "error reduction":
        return LargestErrorReductionStart(gp, actions, episode_length=budget.episode_length, seed=seed)
    return LargestScoreStart(gp, actions, score=score if method.start == "score" else None, seed=seed)
