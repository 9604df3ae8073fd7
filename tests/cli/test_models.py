from __future__ import annotations

import re
from pathlib import Path

import pytest

from torch_activegp.cli.models import find_model, guess
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import MujocoSimulator


def test_a_model_is_a_file_a_known_name_or_a_factory(folder: Path) -> None:
    assert find_model("rod.xml") == Path("rod.xml")
    assert {find_model(name).name for name in ("emps", "balls")} == {"emps.xml", "balls.xml"}
    (folder / "rods.py").write_text(
        "from torch_activegp.simulators import MujocoSimulator\ndef rod(): return MujocoSimulator('rod.xml')\n"
    )
    assert isinstance(find_model("rods:rod"), MujocoSimulator)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("gone.xml", "Unknown model 'gone.xml'. Wanted an MJCF file (none is there"),
        ("lass", "Unknown model 'lass': did you mean 'laas'? Wanted"),
        ("machines.py", "MuJoCo cannot compile `machines.py`"),
        ("machines:number", "Simulator from `machines:number`, found a int"),
    ],
)
def test_what_is_no_model_says_what_to_do(folder: Path, word: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        find_model(word)


def test_a_word_far_from_all_others_suggests_nothing() -> None:
    assert guess("laas2", ["emps", "laas"]) == ": did you mean 'laas'?"
    assert guess("xyz", ["emps", "laas"]) == "."
