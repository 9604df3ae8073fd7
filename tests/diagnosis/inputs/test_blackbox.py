"""Simulators that only return their next state: how they are read, what is refused, and whole diagnoses."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from torch_activegp.cli.app import app
from torch_activegp.data import Recording
from torch_activegp.diagnosis import diagnose, evaluate
from torch_activegp.diagnosis.inputs.blackbox import BlackBox, accelerations, check_clock
from torch_activegp.diagnosis.inputs.runs import Channels, make_run
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.errors import ConfigurationError, DataError, SimulationError
from torch_activegp.simulators import ActionSpace, FunctionSimulator, StateSpace, semi_implicit_euler

INF = float("inf")


def drifting(names, angles=(), actions=("push",), quaternions=()) -> FunctionSimulator:
    """Every dimension moves by its own index and the first action."""

    def step(state, action):
        return state + torch.arange(len(names)) + action[..., :1]

    space = StateSpace(names, -INF, INF, angles=angles, quaternions=quaternions)
    return FunctionSimulator(step, space, ActionSpace(list(actions), [-1.0, -INF][: len(actions)], 1.0), dt=0.01)


def runs_of(box, *recordings):
    channels = Channels.of(box.model, recordings)
    return [make_run(recording, box.model, channels) for recording in recordings]


def test_canonical_names_come_in_any_order() -> None:
    box = BlackBox.of(drifting(["qvel.b", "qpos.a", "qpos.b", "qvel.a"]))
    assert [box.model.joint(i).name for i in range(2)] == ["a", "b"]
    assert box.order.tolist() == [1, 2, 3, 0]
    after = box.step(np.array([[10.0, 20.0, 30.0, 40.0]]), np.array([[0.5]]))
    np.testing.assert_allclose(after, [[11.5, 22.5, 33.5, 40.5]])


def test_other_names_are_positions_first_and_angles_are_in_rad() -> None:
    box = BlackBox.of(drifting(["x", "tilt", "speed", "rate"], angles=[1], actions=("ctrl.push", "pull")))
    assert [(box.model.joint(i).name, int(box.model.jnt_type[i])) for i in range(2)] == [("x", 2), ("tilt", 3)]
    assert [box.model.actuator(i).name for i in range(2)] == ["push", "pull"]
    assert box.model.actuator_ctrllimited.tolist() == [1, 0]
    assert box.model.actuator_ctrlrange[0].tolist() == [-1.0, 1.0]
    assert "tilt in rad; x in m" in box.notes()[2]
    assert "per unit of inertia" in box.notes()[0]


@pytest.mark.parametrize(
    ("names", "quaternions"),
    [
        (["a", "b", "c"], ()),
        (["qpos.a", "qvel.b"], ()),
        (["qpos.a", "qvel.a", "act.m"], ()),
        (list("wxyzabcd"), (0,)),
    ],
)
def test_another_state_is_refused(names, quaternions) -> None:
    with pytest.raises(ConfigurationError, match="positions and their velocities wanted from a FunctionSimulator"):
        BlackBox.of(drifting(names, quaternions=quaternions))


def test_angles_have_no_leaps() -> None:
    box = BlackBox.of(drifting(["tilt", "rate"], angles=[0]))
    state = np.array([[math.pi - 0.1, 0.0]])
    for turn in range(1, 8):
        state = box.step(state, np.ones((1, 1)))
        np.testing.assert_allclose(state, [[math.pi - 0.1 + turn, 2.0 * turn]])


def test_a_network_in_single_precision_is_fed_what_it_takes() -> None:
    torch.manual_seed(0)
    layer = torch.nn.Linear(2, 2)
    box = BlackBox.of(FunctionSimulator(lambda x, u: layer(x), 2, 1, dt=0.1))
    assert box.dtype == torch.float32
    after = box.step(np.array([[1.0, 2.0]]), np.zeros((1, 1)))
    np.testing.assert_allclose(after, layer(torch.tensor([[1.0, 2.0]])).detach(), rtol=1e-6)


@pytest.mark.parametrize(
    ("fn", "words"),
    [
        (lambda x, u: x[..., :1], "wanted the next states"),
        (lambda x, u: {}["mass"], "FunctionSimulator failed .* KeyError: 'mass'"),
    ],
)
def test_a_simulator_that_fails_is_named(fn, words) -> None:
    with pytest.raises(SimulationError, match=words):
        BlackBox.of(FunctionSimulator(fn, 2, 1, dt=0.1))


def test_effects_are_accelerations_and_none_edits_a_model(black) -> None:
    box = BlackBox.of(black.simulator())
    recording = black.record("none", 0)
    channels = Channels.of(box.model, [recording])
    effects = accelerations(effects_for(box.model, channels, runs_of(box, recording)))
    assert not {"soft", "bristles"} & {effect.variant for effect in effects}
    names = {effect.name for effect in effects}
    assert {"viscous_friction", "coulomb_friction", "stribeck_friction", "hysteresis", "cogging"} <= names
    assert {"actuator_delay", "sensor_gain", "joint_stop"} <= names
    assert not names & {"armature_error", "gravity_error", "payload_mass", "backlash", "center_of_mass_offset"}
    assert not [p.unit for effect in effects for p in effect.parameters if "N" in p.unit]
    units = {(e.name, p.name): (p.unit, p.low) for e in effects for p in e.parameters}
    assert units["viscous_friction", "coefficient"] == ("1/s", -INF)
    assert units["linear_spring", "stiffness"] == ("1/s2", -INF)
    assert units["coulomb_friction", "level"] == ("rad/s2", 0.0)
    assert units["quadratic_drag", "coefficient"] == ("1/rad", -INF)


def test_a_time_step_that_does_not_fit_is_refused(black) -> None:
    words = (
        r"run0: rows every 0.03 s \(the time step of OdeSimulator\) or a multiple of it wanted, found every 0.02 s\. "
        r"Give the simulator a time step that fits, for example 0.02 s, or resample the recording\."
    )
    with pytest.raises(DataError, match=words):
        diagnose(black.simulator(0.03), [black.record("none", 0)])
    box = BlackBox.of(black.simulator(0.005))
    assert check_clock(box, runs_of(box, black.record("none", 0))) == 4


def test_uneven_and_different_clocks_are_refused(black) -> None:
    box, first = BlackBox.of(black.simulator(0.01)), black.record("none", 0)
    slower = first.replace({"time": 1.5 * first.time})
    with pytest.raises(DataError, match=r"rows every 0.02 s as in run0 wanted, found every 0.03 s"):
        check_clock(box, runs_of(box, first, slower))
    late = first.time.clone()
    late[5] -= 0.012
    with pytest.raises(DataError, match=r"found intervals from 0.008 to"):
        check_clock(box, runs_of(box, first.replace({"time": late})))


def test_an_external_force_is_refused(black) -> None:
    recording = black.record("none", 0)
    pushed = recording.replace({"qfrc.theta": torch.ones(len(recording))})
    with pytest.raises(DataError, match=r"column `qfrc\.theta`: a control of OdeSimulator wanted"):
        diagnose(black.simulator(), [pushed])


def test_a_prescribed_joint_is_refused() -> None:
    box = BlackBox.of(drifting(["qpos.a", "qpos.b", "qvel.a", "qvel.b"]))
    columns = {"time": np.arange(40) * 0.01, "qpos.a": np.arange(40) * 0.02, "qpos.b": np.arange(40) * 0.03}
    held = Recording.from_columns("run", columns, prescribed=("b",))
    for ask in (diagnose, evaluate):
        with pytest.raises(DataError, match="run: `b` is said to be prescribed, and FunctionSimulator only returns"):
            ask(box.simulator, [held])


def test_velocities_that_are_no_rates_are_refused(black) -> None:
    inner = black.simulator()

    def swapped(state, action):
        return inner.step(state.flip(-1), action).flip(-1)

    simulator = FunctionSimulator(swapped, StateSpace(["theta", "speed"], -INF, INF), inner.action_space, inner.dt)
    with pytest.raises(ConfigurationError, match="the velocity of `theta` wanted as the rate of its position"):
        diagnose(simulator, [black.record("none", 0)])


def test_nothing_is_named_where_nothing_was_left_out(black) -> None:
    simulator = black.simulator()
    found = diagnose(simulator, [black.record("none", i) for i in range(3)], [black.record("none", 9)])
    assert (found.verdict, found.effects) == ("none", ())
    assert found.corrected is simulator
    assert any("act as accelerations" in note for note in found.details["notes"])
    assert not any("half a time step" in note for note in found.details["notes"])


def test_discretisation_is_not_named(black) -> None:
    """Semi-implicit Euler looks as if the controls of the truth came half a time step late."""
    simulator = black.simulator()
    simulator.integrator = semi_implicit_euler
    found = diagnose(simulator, [black.record("none", i) for i in range(3)], [black.record("none", 9)])
    assert (found.verdict, found.effects) == ("none", ())
    assert any("half a time step later" in note for note in found.details["notes"])


def test_damping_and_a_spring_are_named_with_their_parameters(black, tmp_path) -> None:
    runs = [black.record("viscous spring", i) for i in range(3)]
    found = diagnose(black.simulator(), runs, [black.record("viscous spring", 9)])
    assert found.verdict == "named"
    values = {effect.name: effect.parameters for effect in found.effects}
    assert set(values) == {"viscous_friction", "linear_spring"}
    damping, stiffness = values["viscous_friction"]["coefficient"], values["linear_spring"]["stiffness"]
    assert damping.value == pytest.approx(black.damping, rel=0.03)
    assert stiffness.value == pytest.approx(black.stiffness, rel=0.03)
    assert (damping.unit, stiffness.unit) == ("1/s", "1/s2")
    errors = found.details["fit"]["holdout"]["free_run"]
    assert errors["after"] < 1.5 * errors["noise"] < 0.1 * errors["before"]
    assert {law["unit_y"] for law in found.evidence["laws"]} == {"rad/s2"}
    assert [effect.mjcf for effect in found.effects] == [None, None]
    found.save(tmp_path)
    assert not (tmp_path / "corrected.xml").exists()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_simulator_on_a_gpu_is_diagnosed(black) -> None:
    runs = [black.record("viscous spring", i) for i in range(3)]
    found = diagnose(black.simulator().to("cuda"), runs, [black.record("viscous spring", 9)])
    assert (found.verdict, {effect.name for effect in found.effects}) == (
        "named",
        {"viscous_friction", "linear_spring"},
    )


def test_what_is_not_on_the_list_is_unknown_and_learned(black) -> None:
    runs = [black.record("unlisted", i, 5.0) for i in range(2)]
    found = diagnose(black.simulator(), runs, [black.record("unlisted", 9)])
    assert (found.verdict, found.effects) == ("unknown", ())
    assert found.details["location"][0]["target"] == "joint:theta"
    errors = found.details["fit"]["holdout"]["free_run"]
    assert errors["gp"] < 0.7 * errors["before"]
    assert found.learned.state_space.names == ("theta", "speed")


def test_the_command_takes_a_factory(black, tmp_path, monkeypatch) -> None:
    (tmp_path / "pendulums.py").write_text(
        "import math, torch\n"
        "from torch_activegp.simulators import *\n"
        "def rates(x, u): return torch.cat((x[..., 1:], 2 * u - 9 * torch.sin(x[..., :1])), -1)\n"
        "def make():\n"
        "    space = StateSpace(['qpos.theta', 'qvel.theta'], -math.inf, math.inf, angles=[0])\n"
        "    return OdeSimulator(rates, space, ActionSpace(['ctrl.motor'], -5, 5), 0.02)\n"
    )
    for name, seed in (("a", 0), ("b", 1), ("test", 9)):
        save(black.record("viscous spring", seed), tmp_path / f"{name}.csv")
    monkeypatch.chdir(tmp_path)
    words = ["diagnose", "pendulums:make", "a.csv", "b.csv", "--holdout", "test.csv", "--out", "out"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert {effect["name"] for effect in found["effects"]} == {"viscous_friction", "linear_spring"}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "act as accelerations" in page
    assert "MJCF cannot hold" not in page


def save(recording: Recording, path) -> None:
    table = np.stack([recording[column].numpy() for column in recording.columns], axis=1)
    np.savetxt(path, table, delimiter=",", header=",".join(recording.columns), comments="")
