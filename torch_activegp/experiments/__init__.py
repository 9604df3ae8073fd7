"""Experiments: tasks, methods, and the paper's figures."""

from torch_activegp.experiments.bounds import set_bounds
from torch_activegp.experiments.claims import Claim, check_claims
from torch_activegp.experiments.evaluation import GridEvaluation
from torch_activegp.experiments.figures import draw_figures
from torch_activegp.experiments.methods import METHODS, Budget, Method, make_loop
from torch_activegp.experiments.study import Step, Trial, make_trials, records_table, run_study, run_trial
from torch_activegp.experiments.task import (
    FITTED,
    PRINTED,
    TASKS,
    GPSettings,
    Task,
    pendulum,
    pendulum_brake,
    pendulum_gymnasium,
)
from torch_activegp.experiments.user_simulator import UserSimulator

__all__ = [
    "FITTED",
    "METHODS",
    "PRINTED",
    "TASKS",
    "Budget",
    "Claim",
    "GPSettings",
    "GridEvaluation",
    "Method",
    "Step",
    "Task",
    "Trial",
    "UserSimulator",
    "check_claims",
    "draw_figures",
    "make_loop",
    "make_trials",
    "pendulum",
    "pendulum_brake",
    "pendulum_gymnasium",
    "records_table",
    "run_study",
    "run_trial",
    "set_bounds",
]
