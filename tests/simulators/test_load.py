from __future__ import annotations

import sys
from pathlib import Path

import pytest

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.load import is_factory, load_factory, load_simulator
from torch_activegp.simulators.mujoco import MujocoSimulator
from torch_activegp.simulators.pendulum import Pendulum

ROD = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
MODULE = """
from torch_activegp.simulators import Pendulum
def light(): return Pendulum(m=0.5)
ready = Pendulum(m=0.25)
def wrong(): return 3
def fails(): raise LookupError("no bench free")
numbers = (1, 2)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "rod.xml").write_text(ROD)
    (tmp_path / "my_machines.py").write_text(MODULE)
    (tmp_path / "needs_more.py").write_text("import a_module_that_nobody_has")
    (tmp_path / "half_written.py").write_text("def make(:")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("my_machines", None)


def test_a_file_becomes_a_mujoco_simulator_with_its_options(folder: Path) -> None:
    simulator = load_simulator("rod.xml", frame_skip=3, external_force=True)
    assert isinstance(simulator, MujocoSimulator)
    assert (simulator.frame_skip, simulator.action_dim) == (3, 1)
    (folder / "model.txt").write_text(ROD)
    assert isinstance(load_simulator(str(folder / "rod.xml")), MujocoSimulator)


@pytest.mark.parametrize(
    ("source", "mass"),
    [("my_machines:light", 0.5), ("my_machines:ready", 0.25), ("torch_activegp.simulators.pendulum:Pendulum", 1.0)],
)
def test_a_factory_is_called_and_an_instance_taken(folder: Path, source: str, mass: float) -> None:
    path = list(sys.path)
    simulator = load_simulator(source)
    assert isinstance(simulator, Pendulum)
    assert simulator.m.item() == mass
    assert sys.path == path


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        ("nowhere.xml", {}, "found no file `nowhere.xml`"),
        ("pendulum", {}, "found `pendulum`, which is neither"),
        ("a-b:c", {}, "which is neither"),
        ("no_such_module:make", {}, "found no module `no_such_module`.*working folder"),
        ("needs_more:make", {}, "found no module `a_module_that_nobody_has` while importing `needs_more`"),
        ("my_machines:heavy", {}, "found no `heavy` in module `my_machines`"),
        ("my_machines:wrong", {}, "found a int. Wrap a function"),
        ("my_machines:fails", {}, "`my_machines:fails` raised LookupError: no bench free"),
        ("half_written:make", {}, "importing `half_written` raised SyntaxError"),
        ("my_machines:light", {"frame_skip": 2}, "`frame_skip` and `external_force` are for MJCF files"),
    ],
)
def test_errors_say_what_is_wrong(folder: Path, source: str, options: dict[str, int], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load_simulator(source, **options)


def test_any_object_can_be_loaded(folder: Path) -> None:
    assert load_factory("my_machines:wrong") == 3
    assert load_factory("my_machines:numbers") == (1, 2)


@pytest.mark.parametrize(
    ("word", "answer"), [("a.b:c", True), ("a:c", True), ("a", False), ("a:", False), (":c", False), ("a-b:c", False)]
)
def test_a_factory_is_known_by_its_form(word: str, answer: bool) -> None:
    assert is_factory(word) == answer
