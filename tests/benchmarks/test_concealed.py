"""The truth of the concealed cases is right, and its scorer gives what is due."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest

pytest.importorskip("numba")

from benchmarks.concealed import conceal
from benchmarks.concealed.cases import COUNTS, list_cases, make_case
from benchmarks.concealed.dynamics import mass_and_bias, read_tree, room
from benchmarks.concealed.evaluate import touches
from benchmarks.concealed.peers import regression
from benchmarks.concealed.plant import A, J, read_plant
from benchmarks.concealed.systems import SYSTEMS, write_model
from benchmarks.concealed.truth import Motion, open_loop, simulate


@pytest.mark.parametrize("name", SYSTEMS)
def test_mass_matrix_and_bias_are_those_of_the_engine(name: str) -> None:
    rng = np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(write_model(SYSTEMS[name], 100, rng))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = 0.1 * rng.normal(size=model.nq), rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    expected, mass, bias = (np.zeros((model.nv, model.nv)), np.zeros((model.nv, model.nv)), np.zeros(model.nv))
    mujoco.mj_fullM(model, data, expected)
    mass_and_bias(read_tree(model), data.qpos.copy(), data.qvel.copy(), room(model.nv), mass, bias)
    np.testing.assert_allclose(mass + np.diag(model.dof_armature), expected, atol=1e-12)
    np.testing.assert_allclose(bias, data.qfrc_bias, atol=1e-12)


@pytest.mark.parametrize("name", SYSTEMS)
def test_without_an_effect_truth_and_nominal_agree_far_below_the_noise(name: str) -> None:
    rng = np.random.default_rng(1)
    system = SYSTEMS[name]
    model = mujoco.MjModel.from_xml_string(write_model(system, 100, rng))
    model.opt.timestep, model.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    model.dof_frictionloss[:] = 0  # the engine's dry friction creeps
    if name == "striker":
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    plant, data = read_plant(model), mujoco.MjData(model)
    time = np.arange(0, 1, 0.01)
    size = 0.3 if system.servo else 0.2 / model.actuator_gear[:, 0] * plant.tree.mass[0]
    controls = np.sin(2 * np.pi * 0.8 * time)[:, None] * np.broadcast_to(size, model.nu)
    q0 = rng.uniform(0.1, 0.3, model.nq) * system.spread
    motion = simulate(plant, open_loop(time, controls, model.nv), q0, np.zeros(model.nv))
    data.qpos[:] = q0
    for row, control in zip(motion.q, controls, strict=True):
        np.testing.assert_allclose(row, data.qpos, atol=2e-5)
        data.ctrl[:] = control
        for _ in range(100):
            mujoco.mj_step(model, data)


def free_block(**columns: float) -> Any:
    """A block of 2 kg on a slide without losses."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='b'><joint name='x' type='slide' axis='1 0 0' armature='1'/>"
        "<geom type='box' size='.1 .1 .1' mass='2'/></body></worldbody>"
        "<actuator><motor name='m' joint='x'/></actuator></mujoco>"
    )
    plant = read_plant(model)
    for name, value in columns.items():
        plant.joint[0, J[name]] = value
    return plant


def test_dry_friction_sticks_exactly_and_then_slides_as_the_formula_says() -> None:
    time = np.arange(0, 1, 0.01)
    plant = free_block(DRY_FORTH=1.5, DRY_BACK=1.5)
    for push, acceleration in ((1.4, 0.0), (2.1, 0.2)):
        motion = simulate(plant, open_loop(time, np.full((100, 1), push), 1), [0.0], [0.0])
        np.testing.assert_allclose(motion.q[:, 0], acceleration * time**2 / 2, atol=1e-9)


def test_play_moves_the_load_only_when_the_rotor_has_crossed_it() -> None:
    time = np.arange(0, 0.5, 0.01)
    motion = simulate(free_block(GAP=0.2), open_loop(time, np.ones((50, 1)), 1), [0.0], [0.0])
    contact = np.sqrt(2 * 0.1)  # the rotor of 1 kg crosses half the gap under 1 N
    assert np.all(motion.q[time < contact - 0.01] == 0)
    after = time > contact + 0.02
    speed, since = contact / 3, time[after] - contact  # inelastic: momentum is shared
    np.testing.assert_allclose(motion.q[after, 0], speed * since + since**2 / 6, atol=2e-4)


@pytest.mark.parametrize("delay", [0.0, 0.00333, 0.0215])
def test_a_delay_ends_within_a_step_of_the_truth(delay: float) -> None:
    plant, time = free_block(), np.arange(0, 0.1, 0.01)
    plant.actuator[0, A.DELAY] = delay
    speed = simulate(plant, open_loop(time, np.ones((len(time), 1)), 1), np.zeros(1), np.zeros(1)).v[-1, 0]
    assert speed == pytest.approx((time[-1] - delay) / 3, abs=1e-12)


def test_poses_in_which_links_meet_are_seen() -> None:
    model = mujoco.MjModel.from_xml_string(write_model(SYSTEMS["arm3"], 100, np.random.default_rng(0)))
    apart, folded = np.zeros((4, 3)), np.tile([0.0, 0.0, 2.6], (4, 1))
    assert not touches(model, [Motion(apart, apart, apart, apart)])
    assert touches(model, [Motion(apart, apart, apart, apart), Motion(folded, apart, apart, apart)])


def test_a_set_is_fixed_by_its_seed_and_large_enough() -> None:
    assert list_cases(3) == list_cases(3)
    kinds = [spec.kind for spec in list_cases(3)]
    assert kinds != [spec.kind for spec in list_cases(4)]
    assert kinds.count("controls") >= 200
    assert len(kinds) - kinds.count("controls") >= 300
    assert set(COUNTS) == set(kinds)


def test_positions_may_be_filtered_forth_and_back_after_they_were_recorded() -> None:
    """Of even records with white noise one in five; nothing else of a case is drawn otherwise."""
    model = mujoco.MjModel.from_xml_string(write_model(SYSTEMS["arm3"], 100, np.random.default_rng(0)))
    plant, rng = read_plant(model), np.random.default_rng(1)
    noise = np.full(3, 1e-3)
    plain = conceal.Recorder(250, noise, 0 * noise, 0.0, 0.0, 0.0, 0.0, False, False, 0.0)
    drawn = [conceal.filtered_after(plain, plant, rng) for _ in range(400)]
    assert 0.12 < np.mean([recorder.corner > 0.0 for recorder in drawn]) < 0.28
    found = next(recorder for recorder in drawn if recorder.corner)
    assert found.concealments == ["filtered noise"]
    for spoilt in ({"jitter": 0.1}, {"missed": 0.01}, {"color": 0.5}, {"step": noise}, {"rate": 50}):
        recorder = dataclasses.replace(plain, **spoilt)
        assert all(conceal.filtered_after(recorder, plant, rng) is recorder for _ in range(40))
    time = np.arange(4000) / 250
    still = np.zeros((4000, 3))
    signal = open_loop(time, still, 3)._replace(noise=1e-3 * np.random.default_rng(2).normal(size=(4000, 3)))
    run = conceal.Run(signal, still[0], still[0])
    columns = conceal.table(run, Motion(still, still, still, still), found, (("a", "b", "c"), ("x", "y", "z")), rng)
    assert np.std(columns["qpos.a"]) == pytest.approx(found.deviation[0], rel=0.1)
    assert found.deviation[0] < 0.7 * noise[0]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    out = tmp_path_factory.mktemp("cases")
    spec = next(spec for spec in list_cases(5, {"single": 2}) if spec.index == 1)
    folder = make_case(spec, out)
    return folder, json.loads((out / "keys" / f"{spec.name}.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_a_case_holds_a_model_and_recordings_and_nothing_of_the_key(made: tuple[Path, dict[str, Any]]) -> None:
    folder, key = made
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    names = sorted(path.name for path in folder.iterdir())
    assert names[0] == "model.xml"
    assert len(names) == 1 + key["recordings"]["train"] + key["recordings"]["test"]
    table = pd.read_csv(folder / "train_1.csv")
    assert {f"qpos.{model.joint(j).name}" for j in range(model.njnt)} <= set(table)
    assert np.diff(table["time"]).min() > 0
    assert key["effects"][0]["name"] == "coulomb_friction"
    assert 1.02 < key["chi2_per_dof"] < 150


@pytest.mark.slow
def test_a_control_that_no_simulation_reproduces_is_drawn_anew(tmp_path: Path, monkeypatch) -> None:
    spec = next(iter(list_cases(5, {"controls": 1})))
    left = iter([84878.0, 1.25])
    monkeypatch.setattr("benchmarks.concealed.cases.misfit", lambda *_: next(left))
    make_case(spec, tmp_path)
    assert json.loads((tmp_path / "keys" / f"{spec.name}.json").read_text(encoding="utf-8"))["chi2_per_dof"] == 1.25


def write_case(folder: Path, viscous: float) -> None:
    text = write_model(SYSTEMS["pendulum"], 200, np.random.default_rng(3))
    model = mujoco.MjModel.from_xml_string(text)
    (folder / "model.xml").write_text(text, encoding="utf-8")
    plant, rng, time = read_plant(model), np.random.default_rng(0), np.arange(0, 6, 0.005)
    plant.joint[0, J.VISCOUS] += viscous
    joint, motor = model.joint(0).name, model.actuator(0).name
    for number in range(4):
        phase = rng.uniform(0, 6, 3)
        push = np.sin(2 * np.pi * np.array([0.4, 0.9, 1.7]) * time[:, None] + phase).sum(1, keepdims=True)
        controls = 0.5 * push / model.actuator_gear[0, 0]
        motion = simulate(plant, open_loop(time, controls, 1), [0.0], [0.0])
        reading = motion.q[:, 0] + 2e-4 * rng.normal(size=len(time))
        columns = {"time": time, f"qpos.{joint}": reading, f"ctrl.{motor}": controls[:, 0]}
        role = "train" if number < 3 else "test"
        pd.DataFrame(columns).to_csv(folder / f"{role}_{number + 1}.csv", index=False)


@pytest.mark.parametrize(("viscous", "verdict"), [(0.2, "named"), (0.0, "none")])
def test_the_usual_regression_does_easy_cases(tmp_path: Path, viscous: float, verdict: str) -> None:
    write_case(tmp_path, viscous)
    answer = regression.diagnose(tmp_path)
    assert answer["verdict"] == verdict
    if viscous:
        assert answer["effects"][0]["name"] == "viscous_friction"
