"""Experiments: tasks, methods, and the paper's figures.

A name is imported when it is first used, so a module of this package costs only what it needs itself.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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

_PLACES = {
    "bounds": "set_bounds",
    "claims": "Claim check_claims",
    "evaluation": "GridEvaluation",
    "figures": "draw_figures",
    "fleet": "Job diagnose_all",
    "learn": "Learned",
    "learned_model": "load_learned save_learned",
    "methods": "METHODS PAPER_METHODS Budget Method make_loop",
    "study": "Step Trial make_trials records_table run_study run_trial",
    "task": "FITTED LOCAL PRINTED TASKS GPSettings Task pendulum pendulum_brake pendulum_gymnasium pendulum_magnet "
    "pendulum_stop",
    "user_simulator": "UserSimulator",
}
_MODULES = {name: module for module, names in _PLACES.items() for name in names.split()}
"""The module of each public name."""

if not TYPE_CHECKING:  # a type checker would let any name pass

    def __getattr__(name: str) -> object:
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
