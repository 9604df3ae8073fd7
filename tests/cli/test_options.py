from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from typer.testing import Result

from torch_activegp.cli.options import output_folder, place


@pytest.mark.parametrize(
    ("system", "name"),
    [
        ("pendulum", "explore-pendulum"),
        ("../a b/rod.xml", "explore-a-b-rod-xml"),
        ("my.lab:real", "explore-my-lab-real"),
    ],
)
def test_the_output_has_a_place_of_its_own(system: str, name: str) -> None:
    assert output_folder(None, "explore", system) == Path("runs") / name
    assert output_folder(Path("here"), "explore", system) == Path("here")


def test_an_empty_name_is_no_place() -> None:
    assert place("a b/c") == Path("a b/c")
    assert place(".") == Path()
    for word in ("", "  "):
        with pytest.raises(typer.BadParameter, match="found an empty name. Give one, such as --out results"):
            place(word)


@pytest.mark.parametrize(
    "words",
    [
        ["diagnose", "rod.xml", "a.csv"],
        ["diagnose-all", "."],
        ["demo"],
        ["evaluate", "rod.xml", "a.csv"],
        ["learn", "rod.xml", "a.csv"],
        ["explore"],
        ["figures"],
    ],
)
def test_no_command_writes_to_a_place_without_a_name(
    run: Callable[..., Result], folder: Path, words: list[str]
) -> None:
    before = sorted(folder.iterdir())
    result = run(*words, "--out", "")
    assert result.exit_code == 2
    assert "Invalid value for '--out': a place to write to wanted" in " ".join(result.stderr.replace("│", " ").split())
    assert sorted(folder.iterdir()) == before
