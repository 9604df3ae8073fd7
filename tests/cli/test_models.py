from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from torch_activegp.cli.models import find_model, guess
from torch_activegp.data import Recording
from torch_activegp.diagnosis import EffectSimulator
from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.saved import saved
from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.simulators import MujocoSimulator
from torch_activegp.simulators.mujoco_model import load_model


def test_a_model_is_a_file_a_known_name_or_a_factory(folder: Path) -> None:
    assert find_model("rod.xml") == Path("rod.xml")
    assert {find_model(name).name for name in ("emps", "balls")} == {"emps.xml", "balls.xml"}
    (folder / "rods.py").write_text(
        "from torch_activegp.simulators import MujocoSimulator\ndef rod(): return MujocoSimulator('rod.xml')\n"
    )
    assert isinstance(find_model("rods:rod"), MujocoSimulator)


def test_a_model_may_be_what_a_diagnosis_saved(folder: Path) -> None:
    model = load_model("rod.xml")
    recording = Recording.from_columns("run", {"time": np.arange(4.0), f"qpos.{model.joint(0).name}": np.arange(4.0)})
    channels = Channels.of(model, [recording])
    simulator = EffectSimulator(model, channels, Candidate(), dt=0.01, substeps=1)
    Path("learned.pt").write_bytes(saved(simulator))
    assert isinstance(find_model("learned.pt"), EffectSimulator)
    Path("learned.pt").write_bytes(b"no")
    with pytest.raises(DataError, match="learned.pt: corrected.pt or learned.pt of a diagnosis wanted"):
        find_model("learned.pt")


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("gone.xml", "Unknown model 'gone.xml'. Wanted an MJCF file (none is there"),
        ("runs/corrected.pt", "found no file 'runs/corrected.pt'"),
        ("lass", "Unknown model 'lass': did you mean 'laas'? Wanted"),
        ("machines.py", "MuJoCo cannot compile `machines.py`"),
        ("machines:number", "Simulator from `machines:number`, found a int"),
    ],
)
def test_what_is_no_model_says_what_to_do(folder: Path, word: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        find_model(word)


def test_a_folder_is_no_model_but_may_hold_some(folder: Path) -> None:
    out = folder / "out"
    out.mkdir()
    with pytest.raises(ConfigurationError, match="Wanted a model, found the folder 'out'. Give an MJCF file"):
        find_model("out")
    for name in ("learned.pt", "corrected.xml", "report.html"):
        (out / name).touch()
    with pytest.raises(ConfigurationError, match=re.escape("Give one of out/corrected.xml, out/learned.pt.")):
        find_model("out")
    for number in range(5):
        (out / f"arm{number}.xml").touch()
    with pytest.raises(ConfigurationError, match=re.escape("out/arm4.xml, ....")):
        find_model("out")


def test_a_word_far_from_all_others_suggests_nothing() -> None:
    assert guess("laas2", ["emps", "laas"]) == ": did you mean 'laas'?"
    assert guess("xyz", ["emps", "laas"]) == "."
