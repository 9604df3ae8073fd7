from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.errors import DataError


def test_without_holdout_the_last_fifth_of_the_runs_is_set_aside(model, record) -> None:
    machine = make_machine(model, [record(name=f"r{i}", seconds=0.5) for i in range(10)], [])
    assert [run.label for run in machine.holdout] == ["r8", "r9"]
    assert len(machine.fit) == 8
    assert machine.notes == ("No held-out runs given: set aside r8, r9.",)
    assert len(make_machine(model, [record(seconds=0.5)] * 3, []).holdout) == 1


def test_of_few_runs_the_end_of_the_longest_is_set_aside(model, record) -> None:
    machine = make_machine(model, [record(name="a", seconds=1.0), record(name="b", seconds=2.0)], [])
    assert [run.label for run in machine.fit] == ["a", "b (first part)"]
    (tail,) = machine.holdout
    assert tail.label == "b (last part)"
    assert len(machine.fit[1]) + len(tail) == 201
    assert tail.time[0] == 0.0
    whole = make_machine(model, [record(name="b", seconds=2.0)], [record()]).fit[0]
    np.testing.assert_array_equal(np.vstack([machine.fit[1].position, tail.position]), whole.position)
    np.testing.assert_array_equal(tail.control, whole.control[160:])
    np.testing.assert_array_equal(machine.fit[1].control, whole.control[: len(machine.fit[1]) - 1])
    assert "the last fifth of b" in machine.notes[0]


def test_too_short_a_run_is_not_divided(model, record) -> None:
    with pytest.raises(DataError, match="a: too short to set the last fifth of it aside, 51 rows found, 60 wanted"):
        make_machine(model, [record(name="a", seconds=0.5)], [])


@pytest.mark.parametrize(("lengths", "kept", "said"), [
    ((201, 30), [201], "kept1"),
    ((201, 61, 60), [201, 61], "kept2"),
    ((201, 30, 40), [201], "kept1 and 1 more"),
    ((30, 40), [30, 40], ""),
    ((201, 100), [201, 100], ""),
])  # fmt: skip
def test_held_out_pieces_that_are_too_short_to_be_forecast_are_left_out(record, model, lengths, kept, said) -> None:
    """Where others can be. By clocks that begin anywhere."""
    shown = []
    for number, rows in enumerate(lengths):
        whole = record("none", number)
        columns = {name: whole[name].numpy()[:rows] for name in ("time", "qpos.hip", "ctrl.drive")}
        columns["time"] = columns["time"] + 12.3
        shown.append(Recording.from_columns(f"kept{number}", columns))
    machine = make_machine(model, [record("none", 5)], shown)
    assert [len(run) for run in machine.holdout] == kept
    notes = [note for note in machine.notes if "less than 0.6 s" in note]
    assert [note.partition(":")[0] for note in notes] == ([said] if said else [])


@pytest.mark.parametrize(("rows", "kept", "fitted"), [
    ((300, 220, 31), [220], [300, 31]),
    ((31, 300, 30, 220), [220], [31, 300, 30]),
    ((300, 31, 30, 29, 28, 27, 26, 25), [60], [31, 30, 29, 28, 27, 26, 25, 240]),
    ((220, 220, *(30,) * 14), [220], [220, *(30,) * 14]),
])  # fmt: skip
def test_pieces_too_short_to_be_forecast_are_fitted_and_not_set_aside(record, model, rows, kept, fitted) -> None:
    """All that lasts long enough but one run, at most; the end of that one where there is no other."""
    pieces = []
    for number, count in enumerate(rows):
        whole = record("none", number, seconds=3.0)
        columns = {name: whole[name].numpy()[:count] for name in ("time", "qpos.hip", "ctrl.drive")}
        pieces.append(Recording.from_columns(f"run{number}", columns))
    machine = make_machine(model, pieces, [])
    assert [len(run) for run in machine.holdout] == kept
    assert [len(run) for run in machine.fit] == fitted
