"""From what a user has - an MJCF file, its text, an MjSpec, an MjModel - to a compiled model."""

from __future__ import annotations

import copy
import os
from pathlib import Path
from typing import TypeAlias

import mujoco

from torch_activegp.errors import ConfigurationError

ModelSource: TypeAlias = str | os.PathLike[str] | mujoco.MjSpec | mujoco.MjModel
"""Path of an MJCF, URDF or MJB file, MJCF text, or an object of MuJoCo's."""


def load_model(source: ModelSource) -> mujoco.MjModel:
    """Compiles a model, or copies a compiled one.

    Args:
        source: path of an MJCF (``.xml``), URDF or binary (``.mjb``) file; MJCF text, recognised by its first ``<``; an
            ``MjSpec``; or an ``MjModel``.

    Returns:
        A model that nobody else holds.

    Raises:
        ConfigurationError: there is no such file, it does not compile, or ``source`` is something else.
    """
    if isinstance(source, mujoco.MjModel):
        return copy.copy(source)
    if isinstance(source, mujoco.MjSpec):
        try:
            return source.copy().compile()
        except ValueError as error:
            raise ConfigurationError(f"MuJoCo cannot compile the MjSpec: {_one_line(error)}") from error
    if isinstance(source, str) and source.lstrip().startswith("<"):
        try:
            return mujoco.MjModel.from_xml_string(source)
        except ValueError as error:
            raise ConfigurationError(f"MuJoCo cannot compile the MJCF text: {_one_line(error)}") from error
    if isinstance(source, str | os.PathLike):
        return _load_file(Path(source))
    raise ConfigurationError(
        f"wanted an MJCF file, MJCF text, an MjSpec or an MjModel, found a {type(source).__name__}."
    )


def _load_file(path: Path) -> mujoco.MjModel:
    if not path.is_file():
        raise ConfigurationError(f"wanted an MJCF file, found no file `{path}` (working folder: {Path.cwd()}).")
    read = mujoco.MjModel.from_binary_path if path.suffix == ".mjb" else mujoco.MjModel.from_xml_path
    try:
        return read(str(path))
    except ValueError as error:
        raise ConfigurationError(f"MuJoCo cannot compile `{path}`: {_one_line(error)}") from error


def _one_line(error: ValueError) -> str:
    return " ".join(str(error).split())
