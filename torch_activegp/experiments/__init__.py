"""Experiments: tasks, methods, and the paper's figures."""

from torch_activegp.experiments.bounds import set_bounds
from torch_activegp.experiments.claims import Claim, check_claims
from torch_activegp.experiments.evaluation import GridEvaluation
from torch_activegp.experiments.figures import draw_figures
from torch_activegp.experiments.fleet import Job, diagnose_all
from torch_activegp.experiments.learn import Learned
from torch_activegp.experiments.learned_model import load_learned, save_learned
from torch_activegp.experiments.methods import METHODS, PAPER_METHODS, Budget, Method, make_loop
from torch_activegp.experiments.study import Step, Trial, make_trials, records_table, run_study, run_trial
from torch_activegp.experiments.task import (
    FITTED,
    LOCAL,
    PRINTED,
    TASKS,
    GPSettings,
    Task,
    pendulum,
    pendulum_brake,
    pendulum_gymnasium,
    pendulum_magnet,
    pendulum_stop,
)
from torch_activegp.experiments.user_simulator import UserSimulator

__all__ = [
    "FITTED",
    "LOCAL",
    "METHODS",
    "PAPER_METHODS",
    "PRINTED",
    "TASKS",
    "Budget",
    "Claim",
    "GPSettings",
    "GridEvaluation",
    "Job",
    "Learned",
    "Method",
    "Step",
    "Task",
    "Trial",
    "UserSimulator",
    "check_claims",
    "diagnose_all",
    "draw_figures",
    "load_learned",
    "make_loop",
    "make_trials",
    "pendulum",
    "pendulum_brake",
    "pendulum_gymnasium",
    "pendulum_magnet",
    "pendulum_stop",
    "records_table",
    "run_study",
    "run_trial",
    "save_learned",
    "set_bounds",
]
