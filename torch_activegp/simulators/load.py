"""From a word on the command line to a simulator: an MJCF file, or a factory of the user's."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.base import Simulator
from torch_activegp.simulators.mujoco import MujocoSimulator
from torch_activegp.simulators.mujoco_model import FILE_SUFFIXES

USER_FAULTS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    ImportError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)
"""What a user's own code may raise: reported with the name of that code, without a traceback of ours."""


def load_simulator(source: str, *, frame_skip: int = 1, external_force: bool = False) -> Simulator:
    """Makes the simulator that a user names in one word.

    Args:
        source: path of an MJCF file, or ``package.module:factory``, where ``factory`` is a function without arguments
            that returns a `Simulator`. The working folder is searched first, then the installed packages.
        frame_skip: time steps of an MJCF model for each action; see `MujocoSimulator`.
        external_force: append the joints' generalised forces to the action of an MJCF model; see `MujocoSimulator`.

    Returns:
        The simulator.

    Raises:
        ConfigurationError: neither a file nor a factory, the module or factory is missing, it returns something else,
            or an option for MJCF comes with a factory.
    """
    if Path(source).suffix.lower() in FILE_SUFFIXES or Path(source).is_file():
        return MujocoSimulator(source, frame_skip=frame_skip, external_force=external_force)
    if not is_factory(source):
        raise ConfigurationError(
            f"wanted an MJCF file (.xml) or `package.module:factory`, found `{source}`, which is neither. "
            "Check the spelling of the path."
        )
    if frame_skip != 1 or external_force:
        raise ConfigurationError(
            f"`{source}` makes its simulator itself: `frame_skip` and `external_force` are for MJCF files."
        )
    simulator = load_factory(source)
    if not isinstance(simulator, Simulator):
        raise ConfigurationError(
            f"wanted a torch_activegp Simulator from `{source}`, found a {type(simulator).__name__}. Wrap a function "
            "(state, action) -> next state in FunctionSimulator."
        )
    return simulator


def is_factory(source: str) -> bool:
    """Whether a word has the form ``package.module:factory``."""
    module_name, _, factory_name = source.partition(":")
    return factory_name.isidentifier() and all(part.isidentifier() for part in module_name.split("."))


def load_factory(source: str) -> object:
    """Calls a factory of the user's.

    Args:
        source: ``package.module:factory``, where ``factory`` is a function or class without arguments, or a finished
            object. The working folder is searched first, then the installed packages.

    Returns:
        What the factory returns, or the object itself.

    Raises:
        ConfigurationError: the module or factory is missing, or one of the two raises an error.
    """
    module_name, _, attribute = source.partition(":")
    with _working_folder_first():
        module = _import(module_name)
        if not hasattr(module, attribute):
            raise ConfigurationError(f"found no `{attribute}` in module `{module_name}` ({module.__file__}).")
        factory = getattr(module, attribute)
        if not callable(factory) or isinstance(factory, Simulator):
            return factory
        try:
            return factory()
        except USER_FAULTS as error:
            raise ConfigurationError(
                f"`{source}` raised {type(error).__name__}: {error}. It is called without arguments and must return "
                "the simulator; try it in Python first."
            ) from error


def _import(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f"found no module `{error.name}` while importing `{name}` (working folder: {Path.cwd()}). Start "
            "from the folder that holds it, or install its package."
        ) from error
    except USER_FAULTS as error:
        raise ConfigurationError(f"importing `{name}` raised {type(error).__name__}: {error}.") from error


@contextmanager
def _working_folder_first() -> Iterator[None]:
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
