from __future__ import annotations

import copy
import logging
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.mujoco_batch import BatchRunner

BOXES = """
<mujoco><option timestep="0.005"/><worldbody><geom type="plane" size="5 5 .1"/>
<body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
<body pos=".05 0 .6"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
# Negative damping integrated explicitly: a spinning rod gains speed until the engine gives up, a rod at rest stays.
RUNAWAY = """
<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body><joint axis="0 1 0" damping="-50"/>
<geom type="capsule" size=".05" fromto="0 0 0 0 0 1" mass="1"/></body></worldbody>
<actuator><motor joint="joint0"/></actuator></mujoco>""".replace('axis="0 1 0"', 'name="joint0" axis="0 1 0"')
DELAY = """
<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body><joint name="h" axis="0 1 0"/>
<geom size=".1" mass="1"/></body></worldbody>
<actuator><motor joint="h" delay="0.03" nsample="4"/></actuator></mujoco>"""


def falling_boxes(size: int, seed: int = 0) -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    model = mujoco.MjModel.from_xml_string(BOXES)
    start = np.concatenate([model.qpos0, np.zeros(model.nv)])
    physics = start + 0.05 * np.random.default_rng(seed).normal(size=(size, len(start)))
    return model, physics, np.zeros((size, 0))


def one_by_one(model: mujoco.MjModel, physics: np.ndarray, control: np.ndarray, nstep: int) -> np.ndarray:
    """The plainest use of MuJoCo: a fresh MjData a sample, no warm start."""
    rows = []
    for row, force in zip(physics, control, strict=True):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.act[:] = np.split(row, [model.nq, model.nq + model.nv])
        data.ctrl[:], data.qfrc_applied[:] = force[: model.nu], force[model.nu :] if len(force) > model.nu else 0.0
        mujoco.mj_step(model, data, nstep=nstep)
        rows.append(np.concatenate([data.qpos, data.qvel, data.act]))
    return np.array(rows)


@pytest.mark.parametrize("nthread", [1, 2, None])
@pytest.mark.parametrize("size", [1, 5, 16])
def test_a_step_equals_plain_mujoco_bit_for_bit(nthread: int | None, size: int) -> None:
    model, physics, control = falling_boxes(size)
    after = BatchRunner(model, nthread).step(physics, control, 40)
    np.testing.assert_array_equal(after, one_by_one(model, physics, control, 40))
    assert (after[:, 2] < physics[:, 2]).all()


def test_a_rollout_equals_plain_mujoco_bit_for_bit() -> None:
    model, physics, control = falling_boxes(3)
    states = BatchRunner(model).rollout(physics, np.zeros((3, 7, 0)), 5)
    assert states.shape == (3, 7, model.nq + model.nv)
    for index in range(7):
        np.testing.assert_array_equal(states[:, index], one_by_one(model, physics, control, 5 * (index + 1)))


def test_equal_inputs_give_equal_bits_whatever_ran_in_between() -> None:
    model, physics, control = falling_boxes(6)
    runner = BatchRunner(model)
    before = runner.step(physics, control, 60)
    _, others, other_control = falling_boxes(40, seed=1)
    runner.step(others, other_control, 100)
    runner.rollout(np.full_like(others, np.nan), np.zeros((40, 3, 0)), 2)
    np.testing.assert_array_equal(runner.step(physics, control, 60), before)
    np.testing.assert_array_equal(runner.step(physics[3:4], control[3:4], 60), before[3:4])
    np.testing.assert_array_equal(runner.rollout(physics, np.zeros((6, 1, 0)), 60)[:, 0], before)


def test_external_forces_come_after_the_controls() -> None:
    model = mujoco.MjModel.from_xml_string(DELAY.replace(' delay="0.03" nsample="4"', ""))
    physics, control = np.zeros((3, 2)), np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]])
    runner = BatchRunner(model, external_force=True)
    after = runner.step(physics, control, 3)
    np.testing.assert_array_equal(after, one_by_one(model, physics, control, 3))
    np.testing.assert_allclose(after[0], after[1])
    np.testing.assert_allclose(after[2], 0.0, atol=1e-12)
    np.testing.assert_array_equal(runner.rollout(physics, control[:, None], 3)[:, 0], after)
    np.testing.assert_array_equal(runner.step(physics, 0 * control, 3), 0 * physics)  # no force is left behind


def test_a_delay_lives_through_a_rollout_and_starts_anew_at_a_step() -> None:
    model = mujoco.MjModel.from_xml_string(DELAY)
    runner = BatchRunner(model)
    states = runner.rollout(np.zeros((1, 2)), np.ones((1, 6, 1)), 1)[0]
    assert (states[:3, 1] == 0.0).all()
    assert (states[3:, 1] > 0.0).all()
    assert runner.step(np.zeros((1, 2)), np.ones((1, 1)), 1)[0, 1] == 0.0


@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e12])
@pytest.mark.parametrize("column", [0, 1, 2])
def test_a_bad_input_loses_alone(poison: float, column: int, tmp_path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(RUNAWAY)
    inputs = np.random.default_rng(0).normal(size=(7, 3)) * 1e-3
    runner = BatchRunner(model, 2)
    clean = runner.step(inputs[:, :2], inputs[:, 2:], 3)
    assert np.isfinite(clean).all()
    inputs[4, column] = poison
    after = runner.step(inputs[:, :2], inputs[:, 2:], 3)
    rolled = runner.rollout(inputs[:, :2], inputs[:, None, 2:], 3)[:, 0]
    others = np.arange(7) != 4
    for result in (after, rolled):
        assert np.isnan(result[4]).all()
        np.testing.assert_array_equal(result[others], clean[others])
    assert not list(tmp_path.iterdir())  # MuJoCo's log file
    assert capfd.readouterr().err == ""


def test_a_diverging_rollout_keeps_its_rows_until_then() -> None:
    model = mujoco.MjModel.from_xml_string(RUNAWAY)
    physics = np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 1e-4]])
    states = BatchRunner(model).rollout(physics, np.zeros((4, 60, 1)), 1)
    finite = np.isfinite(states).all(-1)
    assert finite[[0, 2]].all()
    first_bad = finite.argmin(1)
    assert 5 < first_bad[1] < first_bad[3] < 60  # the slower start lasts longer
    for index in (1, 3):
        assert finite[index, : first_bad[index]].all()
        assert np.isnan(states[index, first_bad[index] :]).all()
        plain = one_by_one(model, physics[[index]], np.zeros((1, 1)), int(first_bad[index]))
        np.testing.assert_array_equal(states[index, first_bad[index] - 1], plain[0])
    np.testing.assert_array_equal(states[0], states[2])


def test_a_control_that_is_not_finite_spoils_the_rows_from_there_on() -> None:
    model = mujoco.MjModel.from_xml_string(DELAY.replace(' delay="0.03" nsample="4"', ""))
    controls = np.ones((2, 5, 1))
    for position in range(5):
        controls[0, position] = np.nan
        states = BatchRunner(model).rollout(np.zeros((2, 2)), controls, 2)
        assert np.isnan(states[0]).all(-1).tolist() == [index >= position for index in range(5)]
        assert np.isfinite(states[1]).all()
        controls[0, position] = 1.0


@pytest.mark.parametrize("memory", ["7K", "16K"])  # the engine raises an error, or warns and goes on
def test_an_engine_error_in_one_sample_loses_alone(memory: str, caplog) -> None:
    caplog.set_level(logging.DEBUG)
    crowd = "".join('<body pos="0 0 .05"><freejoint/><geom type="box" size=".1 .1 .1"/></body>' for _ in range(6))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><size memory="{memory}"/><worldbody><geom type="plane" size="5 5 .1"/>{crowd}</worldbody></mujoco>'
    )
    physics = np.tile(np.concatenate([model.qpos0, np.zeros(model.nv)]), (2, 1))
    physics[1, 0 : model.nq : 7] = 3.0 * np.arange(6)  # side by side, and high above the floor
    physics[1, 2 : model.nq : 7] = 100.0
    runner = BatchRunner(model)
    after = runner.step(physics, np.zeros((2, 0)), 2)
    rolled = runner.rollout(physics, np.zeros((2, 3, 0)), 2)
    assert np.isnan(after[0]).all()
    assert np.isnan(rolled[0]).all()
    np.testing.assert_array_equal(after[1], one_by_one(model, physics[1:], np.zeros((1, 0)), 2)[0])
    np.testing.assert_array_equal(rolled[1, 0], after[1])
    assert ("out of memory" in caplog.text) == (memory == "7K")


@pytest.mark.parametrize(("size", "length"), [(0, 2), (3, 0)])
def test_empty_batches_and_rollouts_are_empty(size: int, length: int) -> None:
    model, physics, control = falling_boxes(size)
    runner = BatchRunner(model)
    assert runner.step(physics, control, 2).shape == physics.shape
    assert runner.rollout(physics, np.zeros((size, length, 0)), 2).shape == (size, length, physics.shape[1])


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda runner: pickle.loads(pickle.dumps(runner))])
@pytest.mark.parametrize("used", [False, True])
def test_copies_behave_alike(copied, used: bool) -> None:
    model, physics, control = falling_boxes(4)
    runner = BatchRunner(model, 2)
    if used:
        runner.step(physics, control, 1)
    twin = copied(runner)
    assert twin.nthread == 2
    np.testing.assert_array_equal(twin.step(physics, control, 20), runner.step(physics, control, 20))


def test_calls_from_several_python_threads_do_not_mix() -> None:
    model = falling_boxes(1)[0]
    runner = BatchRunner(model, 2)
    inputs = [falling_boxes(3 + seed, seed)[1:] for seed in range(8)]
    expected = [runner.step(*pair, 30) for pair in inputs]
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda pair: runner.step(*pair, 30), inputs * 4))
    for result, wanted in zip(results, expected * 4, strict=True):
        np.testing.assert_array_equal(result, wanted)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the platform has no fork")
def test_a_forked_process_runs_on_threads_of_its_own() -> None:
    script = f"""
import os, signal, mujoco, numpy as np
from torch_activegp.simulators.mujoco_batch import BatchRunner
runner = BatchRunner(mujoco.MjModel.from_xml_string({BOXES!r}), 2)
physics = np.tile(np.concatenate([runner.model.qpos0, np.zeros(12)]), (4, 1))
before = runner.step(physics, np.zeros((4, 0)), 10)
child = os.fork()
if child == 0:
    signal.alarm(20)
    os._exit(0 if (runner.step(physics, np.zeros((4, 0)), 10) == before).all() else 1)
raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def test_a_model_that_cannot_run_in_batches_is_refused() -> None:
    model = mujoco.MjModel.from_xml_string(BOXES.replace('"0.005"/>', '"0.005"><flag sleep="enable"/></option>'))
    with pytest.raises(ConfigurationError, match="sleep .* Turn that feature off"):
        BatchRunner(model).step(np.zeros((1, model.nq + model.nv)), np.zeros((1, 0)), 1)


def test_all_cores_are_used_where_the_platform_cannot_say_which(monkeypatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    model, physics, control = falling_boxes(8)
    runner = BatchRunner(model)
    runner.step(physics, control, 1)
    assert runner._batch is not None
    assert runner._batch.nthread == 3
