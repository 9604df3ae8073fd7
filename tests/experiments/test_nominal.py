from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.nominal import nominal_simulator
from torch_activegp.simulators import MujocoSimulator

FACTORY = """
from torch_activegp.simulators import ActionSpace, FunctionSimulator, Pendulum, StateSpace

def make():
    def move(state, action):
        return state + 0.1 * action
    return FunctionSimulator(move, StateSpace(["qpos.x"], -1.0, 1.0), ActionSpace(["ctrl.u"], -1.0, 1.0), dt=0.1)

pendulum = Pendulum()
"""


@pytest.fixture
def factory(tmp_path: Path, monkeypatch) -> str:
    (tmp_path / "nominal_factory.py").write_text(FACTORY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "nominal_factory", raising=False)
    return "nominal_factory"


@pytest.mark.parametrize(("dt", "frame_skip"), [(0.02, 4), (0.005, 1), (0.012, 3), (0.002, 1), (None, 1)])
def test_a_file_takes_any_step(slide: str, dt: float | None, frame_skip: int) -> None:
    simulator = nominal_simulator(slide, dt)
    assert isinstance(simulator, MujocoSimulator)
    assert simulator.dt == pytest.approx(dt or 0.005, rel=1e-12)
    assert simulator.frame_skip == frame_skip
    assert simulator.model.opt.timestep <= 0.005
    state, action = torch.tensor([0.0, 1.0]).double(), torch.zeros(1).double()
    assert simulator(state, action)[0].item() == pytest.approx(simulator.dt)  # a frictionless slide


def test_emps_is_the_packaged_model_and_forces_are_appended() -> None:
    assert nominal_simulator("emps").state_space.names == ("qpos.slide", "qvel.slide")
    assert nominal_simulator("emps", 0.01, external_force=True).action_space.names == ("ctrl.motor", "qfrc.slide")


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("multiarm", ("qpos.arm", "qvel.arm")),
        ("laas", ("qpos.rotor", "qvel.rotor")),
        ("balls", ("qpos.height", "qvel.height")),
    ],
)
def test_the_nominal_model_of_every_public_data_set_is_known(name: str, names: tuple[str, str]) -> None:
    assert nominal_simulator(name, 0.01).state_space.names == names


def test_a_factory_keeps_its_step(factory: str) -> None:
    assert nominal_simulator(f"{factory}:make").dt == 0.1
    assert nominal_simulator(f"{factory}:make", 0.1, external_force=True).action_space.names == ("ctrl.u",)
    with pytest.raises(ConfigurationError, match=r"`nominal_factory:make` steps by 0.1 s, and --dt asks for 0.2 s"):
        nominal_simulator(f"{factory}:make", 0.2)


def test_names_must_be_those_of_recorded_columns(factory: str) -> None:
    with pytest.raises(ConfigurationError, match="Rename theta, theta_dot, torque"):
        nominal_simulator(f"{factory}:pendulum")


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan"), float("inf")])
def test_a_step_is_positive(slide: str, dt: float) -> None:
    with pytest.raises(ConfigurationError, match="--dt: wanted a time step > 0 s"):
        nominal_simulator(slide, dt)


def test_inner_states_of_actuators_are_refused(slide: str, tmp_path: Path) -> None:
    path = tmp_path / "filter.xml"
    path.write_text(Path(slide).read_text().replace("<motor", "<general dyntype='filter' dynprm='0.1'"))
    with pytest.raises(ConfigurationError, match=r"inner states \(act.push\), which recordings do not hold"):
        nominal_simulator(str(path))


@pytest.mark.parametrize("name", ["nowhere.xml", "EMPS"])
def test_a_missing_model_is_named(name: str) -> None:
    with pytest.raises(ConfigurationError, match=name):
        nominal_simulator(name)
