from __future__ import annotations

import os
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

import torch_activegp
from torch_activegp.cli import app, main
from torch_activegp.cli.app import console, interruptible, results
from torch_activegp.errors import ConfigurationError

COMMAND = [sys.executable, "-c", "from torch_activegp.cli import main; main()"]


def raising(error: BaseException) -> typer.Typer:
    """An application like ours with one command, which fails."""
    other = typer.Typer(cls=app.info.cls, pretty_exceptions_enable=False)
    other.callback()(lambda: None)

    @other.command()
    def fail() -> None:
        raise error

    return other


@pytest.mark.parametrize("words", [[], ["--help"]])
def test_the_first_page_teaches(run: Callable[..., Result], words: list[str]) -> None:
    text = run(*words).output
    for wanted in ("torch-activegp explore pendulum", "torch-activegp diagnose model.xml", "--version", "Exit codes"):
        assert wanted in text
    for wanted in ("explore", "figures", "learn", "diagnose", "evaluate"):
        assert wanted in text


@pytest.mark.parametrize("command", ["explore", "figures"])
def test_a_command_teaches_in_eighty_columns(
    run: Callable[..., Result], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    result = run(command, "--help")
    assert result.exit_code == 0
    assert f"torch-activegp {command} pendulum" in result.output
    for wanted in ("metrics.csv", "summary.json", ".svg", "--resume", "--seed", "pendulum-gymnasium", "factory"):
        assert wanted in result.output
    assert max(map(len, result.output.splitlines())) <= 80


@pytest.mark.parametrize("command", ["learn", "diagnose", "evaluate"])
def test_a_command_on_recordings_teaches_in_eighty_columns(
    run: Callable[..., Result], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    result = run(command, "--help")
    assert result.exit_code == 0
    assert f"torch-activegp {command} emps emps:t" in result.output
    for wanted in ("MAP.toml", "laas:acc_current", "balls", "factory", "standard deviations"):
        assert wanted in " ".join(result.output.replace("│", " ").split())
    assert max(map(len, result.output.splitlines())) <= 80


def test_the_version(run: Callable[..., Result]) -> None:
    result = run("--version")
    assert (result.exit_code, result.output) == (0, f"torch-activegp {torch_activegp.__version__}\n")


def test_python_runs_the_package_as_the_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["torch-activegp", "--version"])
    with pytest.raises(SystemExit) as end:
        runpy.run_module("torch_activegp", run_name="__main__")
    assert not end.value.code
    assert capsys.readouterr().out.startswith("torch-activegp ")


def test_the_entry_point_calls_the_application(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["torch-activegp", "--version"])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 0
    assert "torch-activegp" in capsys.readouterr().out


def test_an_error_of_the_user_is_one_message_and_code_2() -> None:
    result = CliRunner().invoke(raising(ConfigurationError("Wanted [bold]more[/], found less.")), ["fail"])
    assert result.exit_code == 2
    assert result.stderr == "Error: Wanted [bold]more[/], found less.\n"
    assert result.stdout == ""


def test_an_interrupt_is_code_130() -> None:
    result = CliRunner().invoke(raising(KeyboardInterrupt()), ["fail"])
    assert (result.exit_code, result.stderr) == (130, "Interrupted.\n")


def test_an_error_of_ours_is_not_hidden() -> None:
    result = CliRunner().invoke(raising(ZeroDivisionError()), ["fail"])
    assert isinstance(result.exception, ZeroDivisionError)


def test_an_interrupted_run_says_how_it_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as stopped, interruptible(Path("runs/a")):
        raise KeyboardInterrupt
    assert stopped.value.exit_code == 130
    assert "runs/a keeps every complete episode: run the same command with --resume" in capsys.readouterr().err


def test_the_real_program_ends_with_code_2_and_one_message(folder: Path) -> None:
    words = ["explore", "machines:fails", "--prior", "machines:wrong"]
    environment = {**os.environ, "PYTHONPATH": str(Path(torch_activegp.__file__).parents[1])}
    done = subprocess.run([*COMMAND, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "Error: `machines:fails` raised KeyError: 'the key to the lab'" in done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert not (folder / "runs").exists()


def test_an_unknown_command_is_compared_with_all(run: Callable[..., Result]) -> None:
    result = run("figure")
    assert result.exit_code == 2
    assert "No such command 'figure'. Did you mean 'figures'?" in result.stderr


def test_the_commands_are_listed_in_one_order_whichever_was_called_before(run: Callable[..., Result]) -> None:
    run("learn", "--help")
    text = run("--help").output.split("Commands")[1]
    names = ("diagnose ", "demo ", "diagnose-all ", "evaluate ", "explore ", "figures ", "learn ")
    places = [text.index(f"│ {name}") for name in names]
    assert places == sorted(places)


def test_a_diagnosis_imports_nothing_that_only_other_commands_need(folder: Path) -> None:
    program = """
import sys
from typer.testing import CliRunner
from torch_activegp.cli import app

for command in ("diagnose", "demo", "diagnose-all", "evaluate"):
    assert CliRunner().invoke(app, [command, "--help"]).exit_code == 0, command
    assert "torch_activegp.cli." + command.replace("-", "_") in sys.modules
from torch_activegp.diagnosis import diagnose

unwanted = {"torchrl", "tensordict", "ray", "matplotlib"}
unwanted |= {f"torch_activegp.{name}" for name in ("collectors", "envs", "loops", "planners")}
print(*sorted(unwanted & set(sys.modules)))
"""
    environment = {**os.environ, "PYTHONPATH": str(Path(torch_activegp.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "\n", "")


def test_a_joint_called_x_is_no_picture() -> None:
    """rich takes ``:x:`` for one."""
    for printer in (console, results):
        with printer.capture() as shown:
            printer.print("joint:x: what any effects leave")
        assert "joint:x: what" in shown.get()
