"""From what a user has - an MJCF file, its text, an MjSpec, an MjModel - to a compiled model."""

from __future__ import annotations

import copy
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import mujoco

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.mujoco_warnings import warnings_to

_logger = logging.getLogger(__name__)
FILE_SUFFIXES = (".xml", ".mjcf", ".urdf", ".mjb")
"""Endings of the files of models."""

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
        return _compiled("the MjSpec", source.copy().compile)
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return _compiled("the MJCF text", mujoco.MjModel.from_xml_string, source)
    if isinstance(source, str | os.PathLike):
        return _load_file(Path(source))
    raise ConfigurationError(
        f"wanted an MJCF file, MJCF text, an MjSpec or an MjModel, found a {type(source).__name__}."
    )


def _load_file(path: Path) -> mujoco.MjModel:
    if not path.is_file():
        raise ConfigurationError(f"wanted an MJCF file, found no file `{path}` (working folder: {Path.cwd()}).")
    read = mujoco.MjModel.from_binary_path if path.suffix.lower() == ".mjb" else mujoco.MjModel.from_xml_path
    other = "" if path.suffix.lower() in FILE_SUFFIXES else f", by its name no model ({', '.join(FILE_SUFFIXES)})"
    return _compiled(f"`{path}`{other}", read, str(path))


def _compiled(what: str, build: Callable[..., mujoco.MjModel], *arguments: str) -> mujoco.MjModel:
    try:
        with warnings_to(_logger.warning):
            return build(*arguments)
    except ValueError as error:
        raise ConfigurationError(f"MuJoCo cannot compile {what}: {' '.join(str(error).split())}") from error
