from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

from torch_activegp.data.laas import LAAS_FILES, _pieces, laas_model, load_laas
from torch_activegp.errors import DataError


def table(time: np.ndarray, position: np.ndarray, velocity: float) -> pd.DataFrame:
    return pd.DataFrame({"Time": time, "Position": position, "Velocity": np.full(len(time), velocity)})


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(DataError, match="LAAS has no recording `speed`: one of acc_current, speed_test, speed_test1"):
        load_laas("speed")


def test_a_smooth_run_stays_whole() -> None:
    time = np.arange(1000) * 1e-3
    assert _pieces(table(time, 100 * time, 100.0)) == [(0, 1000)]


@pytest.mark.parametrize("speed", [1.0, 150.0])
def test_a_late_row_is_cut_out(speed: float) -> None:
    time = np.arange(1000) * 1e-3
    stamps = time.copy()
    stamps[500] += 6.5e-3
    stamps[501:507] = stamps[500] + np.arange(1, 7) * 1e-4
    assert _pieces(table(stamps, speed * time, speed))[0] == (0, 500)
    (first, last) = _pieces(table(stamps, speed * time, speed))[-1]
    assert 501 <= first <= 507 and last == 1000


def test_a_jump_of_position_cuts_and_short_parts_are_left_out() -> None:
    time = np.arange(1000) * 1e-3
    position = np.where(time < 0.4, 0.0, 5.0) + np.where(time < 0.5, 0.0, 5.0)
    assert _pieces(table(time, position, 0.0)) == [(0, 400), (500, 1000)]


@pytest.mark.parametrize("name", LAAS_FILES)
def test_the_runs_are_smooth_and_of_the_file(recordings_dir: Path, name: str) -> None:
    runs = load_laas(name)
    raw = pd.read_csv(recordings_dir / "laas_cogging" / f"{name}.txt", skipinitialspace=True).set_index("Time")
    for run in runs:
        assert run.columns == ("time", "qpos.rotor", "ctrl.current")
        assert run.dt == pytest.approx(1e-3, rel=1e-3)
        assert np.diff(run.time.numpy()).max() < 6e-3
        rows = raw.loc[run.time.numpy()]
        np.testing.assert_array_equal(run["ctrl.current"].numpy(), rows["Iq"])
        np.testing.assert_array_equal(run["qpos.rotor"].numpy(), rows["Position"])
    assert sum(map(len, runs)) > {"acc_current": 26600, "speed_test": 7600, "speed_test1": 14990}[name]


@pytest.mark.parametrize("name", ["speed_test", "speed_test1"])
def test_the_uncompensated_half_is_the_rough_one(recordings_dir: Path, name: str) -> None:
    raw = pd.read_csv(recordings_dir / "laas_cogging" / f"{name}.txt", skipinitialspace=True)
    inside = raw["Time"].isin(np.concatenate([run.time.numpy() for run in load_laas(name)]))
    rough, smooth = (raw[part & (raw["Time"] > 0.5)]["Velocity"].std() for part in (inside, ~inside))
    assert rough > 3 * smooth


def test_the_nominal_model_is_inertia_over_torque_constant() -> None:
    model = mujoco.MjModel.from_xml_path(str(laas_model()))
    data = mujoco.MjData(model)
    data.ctrl[model.actuator("current").id] = 0.2
    mujoco.mj_step(model, data, nstep=10)
    assert data.qvel[model.joint("rotor").dofadr[0]] == pytest.approx(0.2 * 0.01 / 1.95e-4, rel=1e-9)
