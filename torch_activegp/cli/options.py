"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from torch_activegp.data.known_sets import KNOWN_MODELS

Seed = Annotated[int, typer.Option(min=0, help="Of every random draw: the same seed gives the same result.")]
Threads = Annotated[int, typer.Option(min=0, help="Threads of the simulator; 0: one for each core.")]
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


def place(word: str) -> Path:
    """Where ``--out`` says that results go; an empty word would be the working folder, which nobody means by it.

    Raises:
        BadParameter: the word is empty.
    """
    if not word.strip():
        raise typer.BadParameter("a place to write to wanted, found an empty name. Give one, such as --out results.")
    return Path(word)


def output_folder(out: Path | None, command: str, system: str) -> Path:
    """The folder that the user chose, or ``runs/COMMAND-SYSTEM``."""
    if out is not None:
        return out
    words = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in system)
    return Path("runs") / f"{command}-{words.strip('-')}"
