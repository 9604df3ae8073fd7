from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path

import gymnasium.envs.mujoco
import mujoco
import numpy as np
import pytest
import torch
from gymnasium.envs.mujoco.half_cheetah_v5 import HalfCheetahEnv

from torch_activegp.errors import ConfigurationError, ShapeError, SimulationError
from torch_activegp.simulators.mujoco import MujocoSimulator

CHEETAH = Path(gymnasium.envs.mujoco.__file__).parent / "assets" / "half_cheetah.xml"
ROD = """
<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body><joint name="hip" axis="0 1 0"/>
<geom type="capsule" size=".05" fromto="0 0 0 0 0 -1" mass="1"/></body></worldbody>
<actuator><motor name="drive" joint="hip" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>"""
MIXED = """
<mujoco><worldbody><geom type="plane" size="5 5 .1"/>
<body pos="0 0 .5"><freejoint name="base"/><geom type="box" size=".1 .1 .1"/>
<body pos=".3 0 0"><joint name="wrist" type="ball"/><geom type="box" size=".1 .02 .02"/></body>
<body pos="0 .3 0"><joint name="wheel"/><geom type="box" size=".1 .02 .02"/></body></body></worldbody>
<actuator><general name="muscle" joint="wheel" dyntype="filter" dynprm="0.1"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def cheetah() -> MujocoSimulator:
    return MujocoSimulator(CHEETAH, frame_skip=5)


def random_inputs(simulator: MujocoSimulator, size: int, scale: float = 0.1) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(size, simulator.state_dim, generator=generator, dtype=torch.float64)
    return simulator.default_state + scale * noise, simulator.action_space.sample((size,), generator)


def test_it_is_gymnasiums_half_cheetah(cheetah: MujocoSimulator, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log file
    env = HalfCheetahEnv()
    states, actions = random_inputs(cheetah, 20, scale=0.3)
    after = cheetah(states, actions)
    for state, action, result in zip(states.numpy(), actions.numpy(), after.numpy(), strict=True):
        env.unwrapped.set_state(state[:9], state[9:])
        env.unwrapped.data.qacc_warmstart[:] = 0.0
        env.step(action)
        expected = np.concatenate([env.unwrapped.data.qpos, env.unwrapped.data.qvel])
        np.testing.assert_allclose(result, expected, atol=1e-10, rtol=0)
    assert (cheetah.state_dim, cheetah.action_dim) == (18, 6)
    assert cheetah.dt == pytest.approx(env.unwrapped.dt)
    env.close()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(
    ("state_batch", "action_batch", "batch"), [((), (), ()), ((), (3,), (3,)), ((2, 1), (3,), (2, 3))]
)
def test_batches_broadcast_and_dtypes_stay(cheetah: MujocoSimulator, dtype, state_batch, action_batch, batch) -> None:
    state = cheetah.default_state.to(dtype).expand(*state_batch, 18)
    actions = torch.full((*action_batch, 4, 6), 0.5, dtype=dtype)
    after, states = cheetah(state, actions[..., 0, :]), cheetah.rollout(state, actions)
    assert (after.shape, after.dtype) == ((*batch, 18), dtype)
    assert (states.shape, states.dtype) == ((*batch, 4, 18), dtype)
    assert torch.equal(states[..., 0, :], after)
    assert after.isfinite().all()


def test_a_rollout_agrees_with_repeated_steps_to_the_tolerance_of_the_solver(cheetah: MujocoSimulator) -> None:
    states, actions = random_inputs(cheetah, 8)
    sequence = actions[:, None].expand(8, 6, 6)
    together = cheetah.rollout(states, sequence)
    for index in range(6):
        states = cheetah(states, actions)
        torch.testing.assert_close(together[:, index], states, atol=1e-5, rtol=1e-4)


def test_equal_inputs_give_equal_bits_whatever_ran_in_between(cheetah: MujocoSimulator) -> None:
    states, actions = random_inputs(cheetah, 30, scale=0.3)
    first = cheetah(states, actions)
    cheetah.rollout(states.flip(0), actions[:, None].expand(30, 3, 6))
    assert torch.equal(cheetah(states, actions), first)
    assert torch.equal(cheetah(states[7], actions[7]), first[7])
    assert torch.equal(MujocoSimulator(CHEETAH, frame_skip=5, nthread=1)(states, actions), first)


def test_one_diverged_sample_loses_alone(cheetah: MujocoSimulator) -> None:
    states, actions = random_inputs(cheetah, 12)
    clean = cheetah(states, actions)
    states[3, 12] = math.inf
    states[5, 12] = 1e11
    after = cheetah(states, actions)
    others = [index for index in range(12) if index not in (3, 5)]
    assert after[[3, 5]].isnan().all()
    assert torch.equal(after[others], clean[others])


def test_frame_skip_repeats_the_control() -> None:
    fine, coarse = MujocoSimulator(ROD), MujocoSimulator(ROD, frame_skip=4)
    assert (fine.dt, coarse.dt) == (0.01, 0.04)
    action = torch.tensor([0.7], dtype=torch.float64)
    start = torch.tensor([0.1, 0.2], dtype=torch.float64)
    assert torch.equal(coarse(start, action), fine.rollout(start, action.expand(4, 1))[-1])


def test_angles_are_wrapped_and_motion_goes_on_across_the_cut() -> None:
    simulator = MujocoSimulator(ROD, frame_skip=10)
    state = torch.tensor([3.1, 2.0], dtype=torch.float64)
    after = simulator(state, torch.zeros(1))
    torch.testing.assert_close(after, torch.tensor([3.3 - 2 * math.pi, 2.0], dtype=torch.float64))
    assert simulator.rollout(state, torch.zeros(3, 1))[:, 0].tolist() == pytest.approx(
        [3.3 - 2 * math.pi, 3.5 - 2 * math.pi, 3.7 - 2 * math.pi]
    )
    assert MujocoSimulator(ROD, frame_skip=10, angles=[])(state, torch.zeros(1))[0] == pytest.approx(3.3)


def test_quaternions_stay_on_the_sphere_and_activations_are_part_of_the_state() -> None:
    simulator = MujocoSimulator(MIXED, frame_skip=10)
    names = simulator.state_space.names
    noise = torch.randn(6, simulator.state_dim, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    states = simulator.default_state + noise
    states[:, names.index("act.muscle")] = 0.0
    after = simulator(states, torch.ones(6, 1))
    for first in simulator.state_space.quaternions:
        torch.testing.assert_close(after[:, first : first + 4].norm(dim=-1), torch.ones(6).double())
    # the filter a' = (u - a) / 0.1 s in ten Euler steps of 2 ms
    expected = 1.0 - (1.0 - 0.002 / 0.1) ** 10
    assert after[:, names.index("act.muscle")].tolist() == pytest.approx([expected] * 6)


def test_external_forces_push_the_joint_and_are_named() -> None:
    simulator = MujocoSimulator(ROD, external_force=True, action_bounds={"qfrc": (-3.0, 3.0)})
    assert simulator.action_space.names == ("ctrl.drive", "qfrc.hip")
    assert simulator.action_space.high.tolist() == [1.0, 3.0]
    by_motor, by_hand = simulator(torch.zeros(2, 2), torch.tensor([[0.5, 0.0], [0.0, 0.5]]))
    assert torch.equal(by_motor, by_hand)
    assert by_motor[1] > 0


def test_the_state_keeps_its_device_and_the_default_is_that_of_the_model(cheetah: MujocoSimulator) -> None:
    assert cheetah(cheetah.default_state, torch.zeros(6)).device == cheetah.default_state.device
    simulator = MujocoSimulator(MIXED)
    assert simulator.default_state.shape == (simulator.state_dim,)
    assert simulator.default_state[:7].tolist() == [0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0]


def test_a_model_without_actuators_takes_empty_actions() -> None:
    simulator = MujocoSimulator(ROD.split("<actuator>")[0] + "</mujoco>")
    assert simulator.action_dim == 0
    after = simulator.rollout(torch.tensor([[0.0, 1.0]]), torch.zeros(1, 5, 0))
    torch.testing.assert_close(after[0, :, 0], torch.arange(1, 6) * 0.01)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda simulator: pickle.loads(pickle.dumps(simulator))])
def test_copies_behave_alike(copied, cheetah: MujocoSimulator) -> None:
    states, actions = random_inputs(cheetah, 5)
    twin = copied(cheetah)
    assert torch.equal(twin(states, actions), cheetah(states, actions))
    assert twin.state_space.names == cheetah.state_space.names
    twin.load_state_dict(cheetah.state_dict())


def test_the_simulator_owns_its_model() -> None:
    model = mujoco.MjModel.from_xml_string(ROD)
    simulator = MujocoSimulator(model)
    start, action = torch.zeros(2), torch.ones(1)
    before = simulator(start, action)
    model.body_mass[:] *= 10
    model.body_inertia[:] *= 10
    assert torch.equal(MujocoSimulator(ROD)(start, action), before)
    assert torch.equal(simulator(start, action), before)
    assert simulator.model.joint(0).name == "hip"


def test_gradients_are_refused_and_only_where_wanted() -> None:
    simulator = MujocoSimulator(ROD)
    state, action = torch.zeros(2, requires_grad=True), torch.zeros(1)
    for call in (lambda: simulator(state, action), lambda: simulator.rollout(state, action[None])):
        with pytest.raises(SimulationError, match="requires a gradient, and MuJoCo gives none"):
            call()
    with torch.no_grad():
        assert simulator(state, action).shape == (2,)


def test_repr_shows_time_step_and_threads() -> None:
    assert "dt=0.02, frame_skip=2, nthread=all" in repr(MujocoSimulator(ROD, frame_skip=2))


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: MujocoSimulator("nowhere.xml"), ConfigurationError, "found no file `nowhere.xml`"),
        (lambda: MujocoSimulator("<mujoco"), ConfigurationError, "cannot compile the MJCF text"),
        (lambda: MujocoSimulator(ROD, frame_skip=0), ConfigurationError, "`frame_skip` >= 1, found 0"),
        (lambda: MujocoSimulator(ROD, nthread=0), ConfigurationError, "`nthread` >= 1, found 0"),
        (lambda: MujocoSimulator(ROD, angles=["knee"]), ConfigurationError, r"no hinge joint \['knee'\]"),
        (lambda: MujocoSimulator(ROD)(torch.zeros(2), torch.zeros(3)), ShapeError, r"action \(..., 1\).*'ctrl.drive'"),
        (lambda: MujocoSimulator(ROD)(torch.zeros(3), torch.zeros(1)), ShapeError, r"state \(..., 2\).*'qpos.hip'"),
        (lambda: MujocoSimulator(ROD).rollout(torch.zeros(2), torch.zeros(1)), ShapeError, "T, 1"),
    ],
)
def test_errors_say_what_is_wrong(build, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        build()
