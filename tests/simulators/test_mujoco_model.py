from __future__ import annotations

import logging
from pathlib import Path

import mujoco
import pytest

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.mujoco_model import load_model

BODY = "<body><joint name='hip' axis='0 1 0'/><geom size='.1' mass='2'/></body>"
XML = f"<mujoco><worldbody>{BODY}</worldbody></mujoco>"


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def binary(path: Path) -> Path:
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(XML), str(path))
    return path


@pytest.mark.parametrize(
    "make",
    [
        lambda folder: write(folder / "rod.xml", XML),
        lambda folder: str(write(folder / "rod.xml", XML)),
        lambda folder: binary(folder / "rod.mjb"),
        lambda folder: "\n  " + XML,
        lambda folder: mujoco.MjSpec.from_string(XML),
        lambda folder: mujoco.MjModel.from_xml_string(XML),
    ],
    ids=["path", "string path", "binary", "text", "spec", "model"],
)
def test_every_source_gives_the_same_model(make, tmp_path: Path) -> None:
    model = load_model(make(tmp_path))
    assert (model.nq, model.nv, model.joint(0).name, model.body_mass[1]) == (1, 1, "hip", 2.0)


def test_the_callers_model_and_spec_stay_theirs() -> None:
    given = mujoco.MjModel.from_xml_string(XML)
    load_model(given).body_mass[1] = 5.0
    assert given.body_mass[1] == 2.0
    spec = mujoco.MjSpec.from_string(XML)
    first = load_model(spec)
    spec.joints[0].damping[0] = 0.5
    assert (first.dof_damping[0], load_model(spec).dof_damping[0]) == (0.0, 0.5)


def test_warnings_of_the_compiler_reach_the_log_and_no_file(tmp_path, monkeypatch, caplog) -> None:
    monkeypatch.chdir(tmp_path)
    with caplog.at_level(logging.WARNING):
        load_model(XML.replace("<worldbody>", "<compiler settotalmass='3'/><worldbody>"))
    assert "settotalmass" in caplog.text
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("nowhere.xml", "found no file `nowhere.xml`"),
        (Path("nowhere.xml"), "found no file `nowhere.xml`"),
        ("<mujoco>", "cannot compile the MJCF text"),
        (XML.replace("mass='2'", "mass='0'"), "mass and inertia of moving bodies"),
        (mujoco.MjSpec.from_string(XML.replace("mass='2'", "mass='0'")), "cannot compile the MjSpec: .*mass"),
        (3, "found a int"),
    ],
)
def test_errors_say_what_is_wrong(source, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load_model(source)


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    path = write(tmp_path / "broken.xml", XML.replace("axis", "axes"))
    with pytest.raises(ConfigurationError, match=r"broken.xml`: .*unrecognized attribute.*axes"):
        load_model(path)
