"""From words on the command line to a task."""

from __future__ import annotations

import importlib

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments import PRINTED, TASKS, Task
from torch_activegp.simulators import load_simulator


def load_task(system: str, prior: str | None) -> Task:
    """The task that a user named.

    Args:
        system: a built-in name, an MJCF file, or ``package.module:factory`` (a Simulator, or a whole Task).
        prior: an MJCF file or ``package.module:factory``; None for built-in systems and whole tasks.

    Raises:
        ConfigurationError: the system is unknown, or a prior is missing or one too many.
    """
    if system in TASKS or _is_task(system):
        if prior is not None:
            raise ConfigurationError(f"The system {system!r} brings its own prior; leave out --prior {prior}.")
        return TASKS[system]() if system in TASKS else _call(system)
    if ":" not in system and not system.endswith(".xml"):
        raise ConfigurationError(
            f"Unknown system {system!r}. Choose one of {', '.join(TASKS)}, or give an MJCF file (*.xml) or "
            "package.module:factory."
        )
    if prior is None:
        raise ConfigurationError(f"The system {system!r} needs an imperfect simulator: pass --prior MODEL.")
    return Task(system, load_simulator(system), load_simulator(prior), PRINTED)


def _is_task(system: str) -> bool:
    if ":" not in system:
        return False
    module, _, name = system.partition(":")
    try:
        factory = getattr(importlib.import_module(module), name, None)
    except ImportError:
        return False
    return getattr(factory, "__annotations__", {}).get("return") in (Task, "Task") or isinstance(factory, Task)


def _call(system: str) -> Task:
    module, _, name = system.partition(":")
    factory = getattr(importlib.import_module(module), name)
    return factory if isinstance(factory, Task) else factory()
