"""Public data sets by the words of the command line: ``emps:train``, ``balls:golf_ball_1``, model ``laas``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from torch_activegp.data.balls import BALLS, DROPS, balls_model, load_balls
from torch_activegp.data.emps import EMPS_FILES, emps_model, load_emps
from torch_activegp.data.laas import LAAS_FILES, laas_model, load_laas
from torch_activegp.data.multiarm import MULTIARM_SPLITS, load_multiarm, multiarm_model
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

KNOWN_MODELS: dict[str, Callable[[], Path]] = {
    "emps": emps_model,
    "multiarm": multiarm_model,
    "laas": laas_model,
    "balls": balls_model,
}
"""Nominal simulator of each data set, by its name."""


def known_names() -> tuple[str, ...]:
    """Return every name that :func:`known_recordings` takes.

    >>> known_names()[:3]
    ('emps:train', 'emps:test', 'multiarm:train')
    """
    parts = {
        "emps": EMPS_FILES,
        "multiarm": MULTIARM_SPLITS,
        "laas": LAAS_FILES,
        "balls": [f"{ball}_{drop}" for ball in BALLS for drop in DROPS],
    }
    return tuple(f"{name}:{part}" for name, words in parts.items() for part in words)


def known_recordings(name: str) -> list[Recording]:
    """Load public recordings.

    Args:
        name: data set and part, one of :func:`known_names`.

    Returns:
        The runs of that part; only ``laas:`` has more than one.

    Raises:
        DataError: there is no such data set or part, or its file cannot be had.
    """
    data_set, _, part = name.partition(":")
    if data_set == "emps":
        return [load_emps(part)]
    if data_set == "multiarm":
        return [load_multiarm(part)]
    if data_set == "laas":
        return load_laas(part)
    if data_set == "balls":
        ball, _, drop = part.rpartition("_")
        return [load_balls(ball if drop in ("1", "2") else part, int(drop) if drop in ("1", "2") else 0)]
    raise DataError(
        f"unknown data set `{name}`: emps:train, emps:test, multiarm:train, multiarm:test, "
        f"{', '.join(f'laas:{part}' for part in LAAS_FILES)} or balls:<ball>_<drop> wanted, or the path of a recording."
    )


def known_model(name: str) -> str:
    """Return the path of a data set's nominal simulator, an MJCF file.

    Args:
        name: one of :data:`KNOWN_MODELS`.

    Raises:
        DataError: there is no such data set.
    """
    if name not in KNOWN_MODELS:
        raise DataError(f"no public data set `{name}` with a model: one of {', '.join(KNOWN_MODELS)} wanted.")
    return str(KNOWN_MODELS[name]())
