from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import scipy.io
import torch

from torch_activegp.data import estimate_velocities, load_emps, load_recordings, resample, to_transitions
from torch_activegp.data.emps import emps_model
from torch_activegp.errors import DataError


def force_balance(recording: object, extra: np.ndarray | None = None) -> np.ndarray:
    """Least squares of mass, viscous, Coulomb friction, offset (and the factor of a further column) on motor force."""
    rows = 10  # 100 Hz
    coarse = resample(recording, 0.001 * rows)
    velocity = coarse["qvel.slide"].numpy()
    terms = [np.diff(velocity) / coarse.dt]
    mean = (velocity[1:] + velocity[:-1]) / 2
    terms += [mean, np.sign(mean), np.ones_like(mean)]
    if extra is not None:
        terms.append(extra[: rows * len(mean)].reshape(-1, rows).mean(axis=1))
    steady = np.abs(mean) > 0.01
    force = 35.15 * coarse["ctrl.motor"].numpy()[:-1]
    return np.linalg.lstsq(np.stack(terms, axis=1)[steady], force[steady], rcond=None)[0]


def test_the_nominal_model_is_a_mass_and_a_motor() -> None:
    model = mujoco.MjModel.from_xml_path(str(emps_model()))
    data = mujoco.MjData(model)
    assert (model.nq, model.nv, model.nu) == (1, 1, 1)
    assert model.joint("slide").type == mujoco.mjtJoint.mjJNT_SLIDE
    assert model.opt.timestep == 0.001
    data.ctrl[model.actuator("motor").id] = 2.0
    data.qvel[0] = 0.3
    mujoco.mj_step(model, data, nstep=100)
    assert data.qvel[0] == pytest.approx(0.3 + 0.1 * 2.0 * 35.15 / 95.11, rel=1e-9)
    data.ctrl[:] = 0
    mujoco.mj_step(model, data, nstep=1000)
    assert data.qvel[0] == pytest.approx(0.3 + 0.1 * 2.0 * 35.15 / 95.11, rel=1e-9)


def test_an_unknown_split_is_refused() -> None:
    with pytest.raises(DataError, match="EMPS has no split `validation`: one of train, test wanted"):
        load_emps("validation")


@pytest.mark.parametrize(("split", "name"), [("train", "DATA_EMPS.mat"), ("test", "DATA_EMPS_PULSES.mat")])
def test_the_recordings_load_as_published(recordings_dir: Path, split: str, name: str) -> None:
    recording = load_emps(split)
    raw = scipy.io.loadmat(recordings_dir / "emps" / name)
    assert len(recording) == 24841
    assert recording.dt == pytest.approx(0.001, rel=1e-3)
    assert recording.columns == ("time", "qpos.slide", "ctrl.motor")
    np.testing.assert_array_equal(recording["qpos.slide"], raw["qm"][:, 0])
    np.testing.assert_array_equal(recording["ctrl.motor"], raw["vir"][:, 0])
    assert recording.name == name
    assert "qg" in recording.notes[0]
    (again,) = load_recordings(recordings_dir / "emps" / name)
    assert torch.equal(again.data["qpos", "slide"], recording.data["qpos", "slide"])


@pytest.mark.parametrize("split", ["train", "test"])
def test_units_and_signs_give_the_published_force_balance(recordings_dir: Path, split: str) -> None:
    mass, viscous, coulomb, offset = force_balance(estimate_velocities(load_emps(split)))
    assert mass == pytest.approx(95.11, rel=0.03)
    assert viscous == pytest.approx(203.5, rel=0.06)
    assert coulomb == pytest.approx(20.39, rel=0.06)
    assert offset == pytest.approx(-3.16, rel=0.1)


def test_the_pulses_are_volts_within_vir_and_no_force(recordings_dir: Path) -> None:
    pulses = scipy.io.loadmat(recordings_dir / "emps" / "DATA_EMPS_PULSES.mat")["pulses_N"][:, 0].astype(float)
    recording = load_emps("test")
    edges = np.flatnonzero(np.diff(pulses))
    leaps = np.diff(recording["ctrl.motor"].numpy())[edges] * np.sign(np.diff(pulses)[edges])
    assert leaps.min() > 4.5
    assert leaps.mean() == pytest.approx(5.07, abs=0.01)
    factor = force_balance(estimate_velocities(recording), extra=pulses)[-1]
    assert abs(factor) < 0.1


def test_transitions_at_a_hundredth_of_a_second(recordings_dir: Path) -> None:
    recording = resample(estimate_velocities(load_emps("train")), 0.01)
    data = to_transitions([recording], ["qpos.slide", "qvel.slide"], ["ctrl.motor", "qfrc.slide"], dt=0.01)
    assert data["state"].shape == (2484, 2)
    step = data["next", "state"][:, 0] - data["state"][:, 0]
    mean_velocity = (data["next", "state"][:, 1] + data["state"][:, 1]) / 2
    assert float((step - 0.01 * mean_velocity).abs().max()) < 2e-5
