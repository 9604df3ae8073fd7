"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Episodes = Annotated[int, typer.Option(help="Episodes per run.")]
Steps = Annotated[int, typer.Option(help="Steps per episode (N in the paper).")]
Horizon = Annotated[int, typer.Option(help="Actions per plan.")]
Seed = Annotated[int, typer.Option(help="Seed of every random draw: same seed, same result.")]
Out = Annotated[Path, typer.Option(help="Output folder; must be new or empty, unless --resume is given.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue the run that the output folder holds.")]
