"""Corrected simulators against MuJoCo stepped by hand."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from torch_activegp.diagnosis import Diagnosis, EffectSimulator
from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.inputs.source import read_source
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.correction import Form
from torch_activegp.diagnosis.simulation.simulator import corrected_simulator
from torch_activegp.errors import ConfigurationError, ShapeError, SimulationError
from torch_activegp.means import SimulatorMean
from torch_activegp.simulators import MujocoSimulator

LEFT, RIGHT = 0.02, 0.3


@pytest.fixture
def candidate(bench: Any) -> Candidate:
    """Viscous friction that differs with the direction, which MJCF does not hold."""
    effect = next(e for e in bench.effects if e.name == "asymmetric_friction" and not e.variant)
    return Candidate((effect,), (np.array([RIGHT, LEFT]),))


@pytest.fixture
def simulator(bench: Any, model: mujoco.MjModel, candidate: Candidate) -> EffectSimulator:
    return EffectSimulator(model, bench.machine.channels, candidate, dt=0.01, substeps=2)


def by_hand(model: mujoco.MjModel, state: np.ndarray, control: np.ndarray, steps: int) -> np.ndarray:
    model = copy.copy(model)
    model.dof_damping[0] = 0.5 * (RIGHT + LEFT)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = state[:1], state[1:]
    for u in control:
        for _ in range(steps):
            data.ctrl[:] = u
            data.qfrc_applied[:] = -0.5 * (RIGHT - LEFT) * np.abs(data.qvel)
            mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])


def test_actions_beyond_the_limits_of_a_drive_do_what_the_limits_let_pass(bench: Any, candidate: Candidate) -> None:
    model = mujoco.MjModel.from_xml_string(bench.xml.replace("<motor", '<motor ctrllimited="true" ctrlrange="-1 1"'))
    simulator = EffectSimulator(model, bench.machine.channels, candidate, dt=0.01, substeps=2)
    states = torch.tensor([[0.3, 1.5]], dtype=torch.float64).expand(2, 2)
    beyond, at = simulator(states, torch.tensor([[5.0], [1.0]], dtype=torch.float64))
    assert torch.equal(beyond, at)


def test_a_step_is_what_mujoco_does_with_the_force_added(simulator: EffectSimulator, model: mujoco.MjModel) -> None:
    states = torch.tensor([[0.3, 1.5], [-0.4, -2.0]], dtype=torch.float64)
    actions = torch.tensor([[0.7], [-0.2]], dtype=torch.float64)
    after = simulator(states, actions)
    for state, action, found in zip(states.numpy(), actions.numpy(), after.numpy(), strict=True):
        np.testing.assert_allclose(found, by_hand(model, state, action[None], 2), atol=1e-9)


def test_a_rollout_is_its_steps(simulator: EffectSimulator, model: mujoco.MjModel) -> None:
    state, actions = (
        torch.tensor([0.3, 1.5], dtype=torch.float64),
        torch.linspace(-1, 1, 7, dtype=torch.float64)[:, None],
    )
    states = simulator.rollout(state, actions)
    current = state
    for action, found in zip(actions, states, strict=True):
        current = simulator(current, action)
        torch.testing.assert_close(found, current)
    np.testing.assert_allclose(states[-1], by_hand(model, state.numpy(), actions.numpy(), 2), atol=1e-9)


def test_a_step_feels_the_motor_behind_a_backlash(bench: Any, model: mujoco.MjModel) -> None:
    """In a rollout, which begins as a recording does, the rotor crosses half the gap first."""
    play = next(e for e in bench.effects if e.name == "backlash" and not e.variant)
    made = EffectSimulator(model, bench.machine.channels, Candidate((play,), (np.array([0.1]),)), dt=0.01, substeps=2)
    state, action = torch.zeros(2, dtype=torch.float64), torch.tensor([1.0], dtype=torch.float64)
    plain = EffectSimulator(model, bench.machine.channels, Candidate(), dt=0.01, substeps=2)
    assert float(plain(state, action)[1]) > 1e-3
    torch.testing.assert_close(made(state, action), plain(state, action), rtol=1e-2, atol=1e-9)
    assert float(made.rollout(state, action[None])[0, 1]) == pytest.approx(0.0, abs=1e-9)


def test_states_behind_an_encoder_on_the_motor_are_the_motors(bench: Any, model: mujoco.MjModel) -> None:
    """One step from rest against a pendulum that hangs half a gap away, and on from where another rollout ended."""
    play = next(e for e in bench.effects if e.name == "backlash" and e.variant == "motor side")
    candidate = Candidate((play,), (np.array([0.1]),))
    made = EffectSimulator(model, bench.machine.channels, candidate, dt=0.01, substeps=2)
    state, action = torch.zeros(2, dtype=torch.float64), torch.tensor([1.0], dtype=torch.float64)
    there, back = made.rollout(state, torch.stack([action] * 30)), made.rollout(state, torch.stack([-action] * 30))
    assert float(there[0, 0]) == pytest.approx(0.0, abs=0.01)  # and not half a gap
    torch.testing.assert_close(there, -back)
    on = made.rollout(there[14], torch.stack([action] * 15))
    torch.testing.assert_close(on, there[15:], rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(made(there[14], action), on[0], rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("batch", [(), (3,), (2, 3), (0,)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_shapes_and_types(simulator: EffectSimulator, batch: tuple[int, ...], dtype: torch.dtype) -> None:
    after = simulator(torch.zeros(*batch, 2, dtype=dtype), torch.zeros(1, dtype=dtype))
    assert after.shape == (*batch, 2)
    assert after.dtype == dtype
    assert simulator.rollout(torch.zeros(2), torch.zeros(*batch, 4, 1)).shape == (*batch, 4, 2)


def test_pickling_keeps_it(simulator: EffectSimulator) -> None:
    state, action = torch.tensor([0.3, 1.5]), torch.tensor([0.7])
    after = simulator(state, action)
    torch.testing.assert_close(pickle.loads(pickle.dumps(simulator))(state, action), after)


def test_refuses_gradients_and_wrong_shapes(simulator: EffectSimulator) -> None:
    with pytest.raises(SimulationError, match="gradient"):
        simulator(torch.zeros(2, requires_grad=True), torch.zeros(1))
    with pytest.raises(ShapeError):
        simulator(torch.zeros(3), torch.zeros(1))


def test_mjcf_makes_a_mujoco_simulator_of_the_same_time_step(bench: Any) -> None:
    source = read_source(MujocoSimulator(mujoco.MjSpec.from_string(bench.xml), frame_skip=2))
    rk4 = int(mujoco.mjtIntegrator.mjINT_RK4)
    for numerics, skip in ((None, 2), (Form(rk4, 0.0025), 4), (Form(rk4, 0.05), 1)):
        made = corrected_simulator(source, bench.machine.channels, Candidate(), bench.xml, numerics)
        assert isinstance(made, MujocoSimulator)
        assert made.frame_skip == skip
        assert made.dt == pytest.approx(0.01)


def test_without_mjcf_the_effects_are_stepped(bench: Any, candidate: Candidate, model: mujoco.MjModel) -> None:
    made = corrected_simulator(read_source(bench.xml), bench.machine.channels, candidate, None)
    assert isinstance(made, EffectSimulator)
    after = made(torch.tensor([0.3, 1.5], dtype=torch.float64), torch.tensor([0.7], dtype=torch.float64))
    np.testing.assert_allclose(after, by_hand(model, np.array([0.3, 1.5]), np.array([[0.7]]), 1), atol=1e-9)


def test_a_model_with_activations_is_refused(bench: Any, candidate: Candidate) -> None:
    text = bench.xml.replace("<motor", '<general dyntype="integrator"')
    assert corrected_simulator(read_source(text), bench.machine.channels, candidate, None) is None
    with pytest.raises(ConfigurationError, match="activations"):
        EffectSimulator(mujoco.MjModel.from_xml_string(text), bench.machine.channels, candidate, dt=0.01, substeps=2)


def test_a_diagnosis_gives_a_prior_mean_in_one_line(diagnosed: Callable[[str], Diagnosis], bench: Any) -> None:
    mean = SimulatorMean(diagnosed("viscous").corrected)
    start = torch.tensor([[0.3, 2.0, 0.0]], dtype=torch.float64)
    speed = mean(start)[1, 0].item()
    plain = MujocoSimulator(bench.xml)(start[:, :2], start[:, 2:])[0, 1].item()
    lost = bench.viscous * 2.0 / 0.33 * 0.005
    assert plain - speed == pytest.approx(lost, rel=0.1)


def test_a_joint_that_was_prescribed_moves_by_itself_again(double: Any) -> None:
    """The corrected simulator is that of the machine, not that of the rig."""
    nominal = double.model()
    channels = Channels.of(nominal, [double.record(0, seconds=1.0)])
    simulator = EffectSimulator(nominal, channels, Candidate(), dt=0.01, substeps=2)
    state = torch.tensor([0.3, -0.2, 0.0, 1.0], dtype=torch.float64)
    actions = torch.zeros(30, 2, dtype=torch.float64)
    expected = MujocoSimulator(nominal, frame_skip=2).rollout(state, actions)
    torch.testing.assert_close(simulator.rollout(state, actions), expected, atol=1e-9, rtol=0)
