"""Experiments: tasks, methods, and the paper's figures."""

from torch_activegp.experiments.claims import Claim, check_claims
from torch_activegp.experiments.evaluation import GridEvaluation
from torch_activegp.experiments.figures import draw_figures
from torch_activegp.experiments.methods import METHODS, Budget, Method, make_loop
from torch_activegp.experiments.study import Trial, records_table, run_study, run_trial
from torch_activegp.experiments.task import PRINTED, TASKS, GPSettings, Task, pendulum, pendulum_brake

__all__ = [
    "METHODS",
    "PRINTED",
    "TASKS",
    "Budget",
    "Claim",
    "GPSettings",
    "GridEvaluation",
    "Method",
    "Task",
    "Trial",
    "check_claims",
    "draw_figures",
    "make_loop",
    "pendulum",
    "pendulum_brake",
    "records_table",
    "run_study",
    "run_trial",
]
