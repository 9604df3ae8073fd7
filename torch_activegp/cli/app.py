"""The command line's frame: one message and exit code 2 for whatever the user can mend."""

from __future__ import annotations

import sys

import typer
from rich.console import Console

from torch_activegp.errors import ActiveGPError

app = typer.Typer(
    name="torch-activegp",
    help="Learn where a simulator is wrong: choose the experiments that tell most, with the simulator as prior.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
console = Console(stderr=True)


def main() -> None:
    """Run the command line; errors that the user can mend end with one message and exit code 2."""
    try:
        app()
    except ActiveGPError as error:
        console.print(f"[bold red]Error:[/] {type(error).__name__}:", end=" ")
        console.print(str(error), markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        console.print("Interrupted. What is complete is saved; run the same command with --resume to go on.")
        sys.exit(130)
