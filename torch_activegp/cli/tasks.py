"""From words on the command line to a task and methods."""

from __future__ import annotations

from collections.abc import Mapping

from torch_activegp.cli.models import guess
from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments import FITTED, METHODS, TASKS, Task, UserSimulator, set_bounds
from torch_activegp.simulators import Simulator, load_simulator
from torch_activegp.simulators.load import is_factory, load_factory


def load_task(system: str, prior: str | None = None, bounds: Mapping[str, tuple[float, float]] | None = None) -> Task:
    """The task that a user named.

    Args:
        system: a built-in name, an MJCF file, or ``package.module:factory`` (a Simulator, or a whole Task).
        prior: an MJCF file or ``package.module:factory``; None for built-in systems and whole tasks.
        bounds: bounds in place of those of the two simulators; see :func:`~torch_activegp.experiments.set_bounds`.

    Raises:
        ConfigurationError: the system is unknown, cannot be made, or a prior is missing or one too many.
    """
    if system in TASKS:
        return _complete(system, TASKS[system](), prior, bounds)
    made = load_factory(system) if is_factory(system) else _load_file(system)
    if isinstance(made, Task):
        return _complete(system, made, prior, bounds)
    if not isinstance(made, Simulator):
        raise ConfigurationError(
            f"Wanted a Simulator or a Task from `{system}`, found a {type(made).__name__}. Wrap a function "
            "(state, action) -> next state in FunctionSimulator."
        )
    if prior is None:
        raise ConfigurationError(
            f"The system `{system}` needs an imperfect simulator as the prior: add --prior with an MJCF file or "
            "package.module:factory."
        )
    simulator = load_simulator(prior)
    for each in (made, simulator):
        set_bounds(each, bounds or {})
    return Task(system, UserSimulator(made, system), UserSimulator(simulator, prior, finite=False), FITTED)


def check_methods(names: list[str]) -> list[str]:
    """Check that methods are known, and named once.

    Raises:
        ConfigurationError: they are not.
    """
    for name in names:
        if name not in METHODS:
            raise ConfigurationError(f"Unknown method {name!r}{guess(name, METHODS)} Choose of {', '.join(METHODS)}.")
    if not names or len(set(names)) < len(names):
        raise ConfigurationError(
            f"Wanted each method once, of {', '.join(METHODS)}; found {', '.join(names) or 'none'}."
        )
    return names


def _complete(system: str, task: Task, prior: str | None, bounds: Mapping[str, tuple[float, float]] | None) -> Task:
    if prior is not None:
        raise ConfigurationError(f"The system `{system}` brings its own imperfect simulator; leave out --prior.")
    for simulator in (task.truth, task.prior):
        set_bounds(simulator, bounds or {})
    return task


def _load_file(system: str) -> Simulator:
    try:
        return load_simulator(system)
    except ConfigurationError as error:
        if "which is neither" not in str(error):
            raise
        raise ConfigurationError(
            f"Unknown system {system!r}{guess(system, TASKS)} Choose of {', '.join(TASKS)}, or give an MJCF file "
            "(.xml) or package.module:factory."
        ) from error
