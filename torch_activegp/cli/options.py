"""Arguments and options that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from torch_activegp.data.known_sets import KNOWN_MODELS
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
Seed = Annotated[int, typer.Option(min=0, help="Of every random draw: the same seed gives the same result.")]
Threads = Annotated[int, typer.Option(min=0, help="Threads of the simulator; 0: one for each core.")]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Output folder: new or empty, unless --resume. By default runs/COMMAND-SYSTEM.", metavar="FOLDER"
    ),
]
Model = Annotated[
    str,
    typer.Argument(
        help="The simulator: an MJCF file; package.module:factory, a function that returns a Simulator; or the nominal "
        f"model of a public data set: {', '.join(KNOWN_MODELS)}."
    ),
]
Holdout = Annotated[
    list[str] | None,
    typer.Option(
        help="Recording to compare on; may be repeated. Without it, a fifth is set aside.", metavar="RECORDING"
    ),
]
Columns = Annotated[
    Path | None,
    typer.Option(
        help="Renames and rescales columns of the recordings; says which joints something else moved.",
        metavar="MAP.toml",
    ),
]
RECORDINGS = (
    "CSV, Parquet, NPZ, HDF5, MAT or a TensorDict memmap, with columns time, qpos.JOINT, qvel.JOINT (may be left out), "
    "ctrl.ACTUATOR, qfrc.JOINT in SI units; a quoted pattern such as 'run*.csv'; or public data: emps:train, "
    "multiarm:train, laas:acc_current, balls:golf_ball_1."
)
"""What a recording on the command line may be."""
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


def output_folder(out: Path | None, command: str, system: str) -> Path:
    """The folder that the user chose, or ``runs/COMMAND-SYSTEM``."""
    if out is not None:
        return out
    words = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in system)
    return Path("runs") / f"{command}-{words.strip('-')}"
