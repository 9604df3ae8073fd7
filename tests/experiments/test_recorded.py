from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.errors import DataError
from torch_activegp.experiments.nominal import nominal_simulator
from torch_activegp.experiments.recorded import (
    check_apart,
    check_columns_known,
    fitted_by_mistake,
    from_row,
    load_apart,
    load_named,
    set_aside,
    with_velocities,
)


def ramp(name: str = "ramp", rows: int = 40, **columns: torch.Tensor) -> Recording:
    time = torch.arange(rows).double() * 0.005
    plain = {"time": time + 7.0, "qpos.slide": 2.0 * time, "qvel.slide": 0 * time + 2, "ctrl.push": torch.arange(rows)}
    return Recording.from_columns(name, plain | columns)


def test_files_patterns_and_data_sets_are_loaded_in_order(tmp_path: Path, recordings_dir: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / f"{name}.csv").write_text("time,qpos.x\n0,0\n1,1\n2,2\n3,4\n")
    (tmp_path / "c.tsv").write_text("time\tqpos.x\n0\t0\n1\t1\n2\t2\n3\t4\n")
    names = [run.name for run in load_named([str(tmp_path / "*.csv"), "emps:test", str(tmp_path / "c.tsv")])]
    assert names == ["a.csv", "b.csv", "DATA_EMPS_PULSES.mat", "c.tsv"]


@pytest.mark.parametrize(
    ("word", "joint", "runs"),
    [("multiarm:train", "arm", 1), ("laas:acc_current", "rotor", 18), ("balls:whiffle_ball_2_1", "height", 1)],
)
def test_every_public_data_set_is_known(recordings_dir: Path, word: str, joint: str, runs: int) -> None:
    recordings = load_named([word])
    assert len(recordings) == runs
    assert {recording.joints for recording in recordings} == {(joint,)}


def test_a_run_counts_once(tmp_path: Path, recordings_dir: Path) -> None:
    (tmp_path / "a.csv").write_text("time,qpos.x\n0,0\n1,1\n2,2\n3,4\n")
    with pytest.raises(DataError, match="a.csv is given 2 times, and would count for as many runs. Name it once"):
        load_named([str(tmp_path / "a.csv"), str(tmp_path / "*.csv")])
    with pytest.raises(DataError, match="golf_ball_1 is given 2 times"):
        load_named(["balls:golf_ball_1", "balls:golf_ball_1"])
    assert len(load_named(["balls:golf_ball_1", "balls:golf_ball_2"])) == 2


def test_what_is_learned_from_and_held_out_is_apart(tmp_path: Path, recordings_dir: Path) -> None:
    (tmp_path / "a.csv").write_text("time,qpos.x\n0,0\n1,1\n2,2\n3,4\n")
    recordings, held_out = load_apart([str(tmp_path / "a.csv"), "balls:golf_ball_1"], ["balls:golf_ball_2"])
    assert [run.name for run in (*recordings, *held_out)] == ["a.csv", "golf_ball_1", "golf_ball_2"]
    for words in (["balls:golf_ball_1"], [str(tmp_path / "*.csv")]):
        with pytest.raises(DataError, match="is both learned from and held out"):
            load_apart([str(tmp_path / "a.csv"), "balls:golf_ball_1"], words)


def test_a_column_map_is_read_even_where_no_file_needs_it(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="nowhere.toml: no such file"):
        load_named([], tmp_path / "nowhere.toml")


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("emps:trian", "EMPS has no split `trian`"),
        ("silverbox:train", "unknown data set `silverbox:train`: emps:train, emps:test, multiarm:train"),
        ("nowhere.csv", "nowhere.csv: no such file"),
    ],
)
def test_an_unknown_name_is_refused(word: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        load_named([word])


def test_a_file_with_a_colon_is_a_file(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run:1").mkdir()
    with pytest.raises(DataError, match="no TensorDict memmap"):
        load_named(["run:1"])


@pytest.mark.parametrize(("runs", "held_out"), [(2, 1), (5, 1), (8, 2), (10, 2)])
def test_a_fifth_of_the_runs_is_set_aside(runs: int, held_out: int) -> None:
    kept, aside, note = set_aside([ramp(f"run{index}") for index in range(runs)])
    assert [run.name for run in kept + aside] == [f"run{index}" for index in range(runs)]
    assert len(aside) == held_out
    assert note.startswith(f"Held out: run{runs - held_out}")


def test_the_last_fifth_of_a_single_run_is_set_aside() -> None:
    kept, aside, note = set_aside([ramp()])
    assert [len(kept[0]), len(aside[0])] == [32, 8]
    assert aside[0].time[0] == pytest.approx(7.0 + 32 * 0.005)
    assert note == "Held out: the last fifth of ramp, rows 33 to 40."
    with pytest.raises(DataError, match="too short, 19 rows, to hold a fifth of them out"):
        set_aside([ramp(rows=19)])


def test_no_file_is_learned_from_and_held_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,qpos.x\n0,0\n1,1\n2,2\n3,4\n")
    first, second = load_named([str(path)]), load_named([str(tmp_path / ".." / tmp_path.name / "a.csv")])
    with pytest.raises(DataError, match="a.csv is both learned from and held out"):
        check_apart(first, second)
    check_apart([ramp()], [ramp()])  # what has no file cannot be told apart


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"qpos.elbow": torch.zeros(40)}, "`m.xml` has no qpos.elbow; it has qpos.slide, qvel.slide, ctrl.push"),
        ({"ctrl.brake": torch.zeros(40)}, "`m.xml` has no ctrl.brake"),
    ],
)
def test_what_the_model_lacks_is_named(slide: str, columns: dict[str, torch.Tensor], message: str) -> None:
    with pytest.raises(DataError, match=message):
        check_columns_known([ramp(**columns)], nominal_simulator(slide), "m.xml")


def test_nothing_is_learned_beside_a_prescribed_joint(slide: str) -> None:
    held = dataclasses.replace(ramp(), prescribed=("slide",))
    with pytest.raises(DataError, match="`slide` is said to be prescribed, and a model that is learned explains every"):
        check_columns_known([held], nominal_simulator(slide), "m.xml")


def test_what_the_recording_lacks_is_named(slide: str) -> None:
    bare = Recording.from_columns("bare", {"time": torch.arange(4), "qpos.slide": torch.zeros(4)})
    with pytest.raises(DataError, match=r"no column ctrl.push, which `m.xml` wants; found time, qpos.slide"):
        check_columns_known([bare], nominal_simulator(slide), "m.xml")
    check_columns_known([ramp()], nominal_simulator(slide), "m.xml")


def test_velocities_of_an_angle_know_no_leap(rod: str, rod_run) -> None:
    recording = rod_run()
    leaps = recording["qpos.hip"].diff().abs().max()
    assert leaps > 6.0
    velocity = with_velocities(recording, nominal_simulator(rod))["qvel.hip"]
    assert velocity.abs().max() < 20.0


def test_a_part_keeps_name_and_notes() -> None:
    part = from_row(ramp(), 10, 20)
    assert (part.name, len(part), part["ctrl.push"][0].item()) == ("ramp", 10, 10.0)


@pytest.mark.parametrize(
    ("words", "holdout", "said"),
    [
        (["run1.csv", "data/test_2.csv"], ["data/test_1.csv"], "data/test_2.csv: fitted, not held out."),
        (["run1.csv", "Holdout2.csv", "holdout3.csv"], ["holdout1.csv"], "Holdout2.csv, holdout3.csv: fitted"),
        (["run1.csv"], ["test1.csv"], None),
        (["test1.csv", "test2.csv"], ["run3.csv"], None),
        (["test1.csv"], [], None),
    ],
)
def test_what_a_shell_takes_from_the_option_is_noticed(words, holdout, said) -> None:
    found = fitted_by_mistake(words, holdout)
    assert (found is None) if said is None else found.startswith(said)
