from __future__ import annotations

from pathlib import Path

import pytest

from torch_activegp.cli.options import output_folder


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
