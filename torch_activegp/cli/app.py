"""The command line's frame: one message and exit code 2 for whatever the user can mend."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from typer.core import TyperGroup
from typer.main import get_group

from torch_activegp.errors import ActiveGPError

FAILED, USAGE, INTERRUPTED = 1, 2, 130
"""Exit codes: some of many failed; input that the user can mend; Ctrl-C."""

console = Console(stderr=True, emoji=False)
"""For progress, notes and errors."""
results = Console(emoji=False)
"""For what the user asked for; can be piped into a file."""


_MODULES = {
    "diagnose": "diagnose",
    "demo": "demo",
    "diagnose-all": "diagnose_all",
    "evaluate": "evaluate",
    "explore": "explore",
    "figures": "figures",
    "learn": "learn",
}
"""Commands, in the order of the help, and the modules of this package that hold them."""


class _Group(TyperGroup):
    """Commands whose errors end with one message and an exit code, however they are called.

    The module of a command is imported when that command is called, so no command waits for what others need.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of all commands."""
        return list(_MODULES)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command; all of them for an unknown name, so that the message can suggest one."""
        if cmd_name not in self.commands:
            for module in [_MODULES[cmd_name]] if cmd_name in _MODULES else _MODULES.values():
                import_module(f"{__package__}.{module}")
            self.commands.update(get_group(app).commands)
        return super().get_command(ctx, cmd_name)

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except ActiveGPError as error:
            console.print("[bold red]Error:[/]", end=" ")
            console.print(str(error), markup=False, highlight=False, soft_wrap=True)
            raise typer.Exit(USAGE) from error
        except KeyboardInterrupt as error:
            console.print("Interrupted.")
            raise typer.Exit(INTERRUPTED) from error


app = typer.Typer(
    name="torch-activegp",
    cls=_Group,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"torch-activegp {version('torch-activegp')}")
        raise typer.Exit


@app.callback()
def _describe(
    show_version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Learn where a simulator is wrong, with the simulator as the prior of a Gaussian process.

    See it work:  `torch-activegp demo` (something is hidden, and found);  `torch-activegp explore pendulum`

    Your machine:  `torch-activegp diagnose model.xml run1.csv run2.csv --holdout run3.csv`

    Every command explains itself with --help. Exit codes: 0 done, 1 some of many machines failed, 2 input that you can
    mend (one message says how), 130 interrupted.
    """


@contextmanager
def interruptible(folder: Path) -> Iterator[None]:
    """Say after Ctrl-C how the run in a folder goes on."""
    try:
        yield
    except KeyboardInterrupt as error:
        console.print(
            f"Interrupted. {folder} keeps every complete episode: run the same command with --resume to go on.",
            highlight=False,
            soft_wrap=True,
        )
        raise typer.Exit(INTERRUPTED) from error


def main() -> None:
    """Run the command line."""
    app()
