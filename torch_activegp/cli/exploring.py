"""Arguments and options of the commands that explore a system."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from torch_activegp.cli.options import place
from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments import TASKS

Bounds = dict[str, tuple[float, float]]

System = Annotated[
    str,
    typer.Argument(
        help=f"The true system: {', '.join(TASKS)}; or your own: an MJCF file, or package.module:factory, a function "
        "that returns a Simulator (or a whole Task). The working folder is searched first."
    ),
]
Prior = Annotated[
    str | None,
    typer.Option(
        help="The imperfect simulator: an MJCF file or package.module:factory. Needed for a system of your own.",
        metavar="MODEL",
    ),
]
BoundsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--bounds",
        help="Where to explore, for states or actions without bounds of their own; may be repeated. "
        "qvel=-5:5 stands for all qvel.*",
        metavar="NAME=LOW:HIGH",
    ),
]
Episodes = Annotated[int, typer.Option(min=1, help="Episodes of each run.")]
Steps = Annotated[int, typer.Option(min=1, help="Steps of each episode (N in the paper).")]
Horizon = Annotated[int, typer.Option(min=1, help="Actions that are planned ahead.")]
Out = Annotated[
    Path | None,
    typer.Option(
        parser=place,
        help="Output folder: new or empty, unless --resume. By default runs/COMMAND-SYSTEM.",
        metavar="FOLDER",
    ),
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with the run in the output folder, e.g. with more --episodes.")
]


def parse_bounds(words: list[str] | None) -> Bounds:
    """Read ``NAME=LOW:HIGH`` words.

    Raises:
        ConfigurationError: a word has another form, or low is not below high.
    """
    bounds: Bounds = {}
    for word in words or ():
        name, _, limits = word.partition("=")
        low, _, high = limits.partition(":")
        try:
            limit = (float(low), float(high))
        except ValueError as error:
            raise ConfigurationError(f"--bounds: wanted NAME=LOW:HIGH, e.g. qvel=-5:5, found {word!r}.") from error
        if not (name.strip() and all(map(math.isfinite, limit)) and limit[0] < limit[1]):
            raise ConfigurationError(f"--bounds: wanted NAME=LOW:HIGH, finite and LOW < HIGH, found {word!r}.")
        bounds[name.strip()] = limit
    return bounds
