from __future__ import annotations

import dataclasses
import json
import os
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from torch_activegp.diagnosis import Checkpoint, Diagnosis, diagnose
from torch_activegp.diagnosis.selection.search import Depth
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import Candidate


@pytest.fixture
def path(tmp_path):
    return tmp_path / "new" / ".progress"


@pytest.fixture
def value(bench):
    """A value with arrays, an effect and a run."""
    effect = bench.effects[0]
    return {
        "candidate": Candidate((effect,), (np.arange(3.0),)),
        "run": bench.machine.fit[0],
        "set": frozenset({effect}),
        "depth": Depth(rounds=0),
    }


def opened(path, shared=(), key="k") -> Checkpoint:
    checkpoint = Checkpoint(path)
    checkpoint.share(shared)
    checkpoint.open(key)
    return checkpoint


def fail() -> None:
    raise AssertionError("computed again")


def test_a_stage_that_is_kept_is_not_computed_again(bench, value, path) -> None:
    shared = [*bench.machine.fit, *bench.effects]
    first, second = opened(path, shared).once("a", lambda: value), opened(path, shared).once("a", fail)
    for found in (first, second):
        assert found["candidate"].effects == (bench.effects[0],)
        assert found["set"] == {bench.effects[0]}
        assert found["depth"] == Depth(rounds=0)
        assert found["run"] is bench.machine.fit[0]
        np.testing.assert_array_equal(found["candidate"].values[0], [0.0, 1.0, 2.0])
    assert [item.name for item in path.parent.iterdir()] == [".progress"]


def test_a_stage_takes_the_place_of_the_one_before(path) -> None:
    asked = []

    def nested(checkpoint: Checkpoint) -> int:
        def inner() -> int:
            asked.append("inner")
            return 1

        def outer() -> int:
            asked.append("outer")
            return checkpoint.once("a", inner) + 1

        return checkpoint.once("b", outer)

    first, second = opened(path), opened(path)
    assert (nested(first), first.stage, first.resumed) == (2, "b", None)
    second.open("k")
    assert (nested(second), second.stage, second.resumed) == (2, "b", "b")
    assert asked == ["outer", "inner"]


def test_what_another_input_left_is_told(path, caplog) -> None:
    first = Checkpoint(path)
    first.open("one")
    first.once("stage", lambda: 1)
    for key, told in (("one", False), ("other", True)):
        caplog.clear()
        Checkpoint(path).open(key)
        assert ("starts anew and takes its place" in caplog.text) == told


def test_what_another_input_left_does_not_count(path) -> None:
    opened(path).once("a", lambda: 1)
    assert opened(path, key="other").once("a", lambda: 2) == 2
    assert opened(path, key="other").once("a", fail) == 2
    assert opened(path).once("a", lambda: 3) == 3


def test_without_a_path_nothing_is_kept(path, value) -> None:
    checkpoint = opened(None)
    assert checkpoint.once("a", lambda: value) is value
    checkpoint.clear()
    assert checkpoint.stage is None


def test_what_is_cleared_is_gone(path) -> None:
    checkpoint = opened(path)
    checkpoint.once("a", lambda: 1)
    checkpoint.clear()
    checkpoint.clear()
    assert (checkpoint.stage, list(path.parent.iterdir())) == (None, [])


class Trap:
    """Runs a command where a careless reader unpickles it."""

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str, str]]:
        return exec, ("raise SystemExit('run')",)


@pytest.mark.parametrize("damage", ["cut", "empty", "trap", "binary"])
def test_a_damaged_file_starts_anew_and_runs_nothing(path, value, bench, caplog, damage) -> None:
    shared = [*bench.machine.fit, *bench.effects]
    opened(path, shared).once("a", lambda: value)
    whole = path.read_bytes()
    head = whole[: whole.index(b"\n") + 1]
    path.write_bytes(
        {"cut": whole[:-20], "empty": b"", "trap": head + pickle.dumps(Trap()), "binary": bytes(range(256))}[damage]
    )
    assert opened(path, shared).once("a", lambda: 7) == 7
    assert (damage in ("cut", "trap")) is ("cannot be read" in caplog.text)


@pytest.mark.parametrize("odd", [lambda: 0, Score])
def test_what_cannot_be_kept_is_only_used(path, odd, caplog) -> None:
    """A function, or a class of ours in place of a value."""
    checkpoint = opened(path)
    assert checkpoint.once("a", lambda: odd) is odd
    assert (checkpoint.stage is None) is ("is not kept" in caplog.text)


def test_an_effect_that_was_not_tried_is_not_kept(path, bench, caplog) -> None:
    assert opened(path).once("a", lambda: bench.effects[0]) is bench.effects[0]
    assert "is not among the effects that were tried" in caplog.text
    assert not path.exists()


def test_a_full_disk_stops_nothing(tmp_path, caplog) -> None:
    (tmp_path / "file").write_text("")
    assert opened(tmp_path / "file" / ".progress").once("a", lambda: 1) == 1
    assert "is not kept" in caplog.text


def test_what_another_process_writes_meanwhile_is_not_taken_for_ones_own(path, monkeypatch) -> None:
    replace = os.replace

    def late(source, target) -> None:
        replace(source, target)
        path.write_bytes(b"k a\n" + pickle.dumps("theirs"))

    monkeypatch.setattr(os, "replace", late)
    assert opened(path).once("a", lambda: "ours") == "ours"
    between = opened(path)
    assert between.stage == "a"
    for header in (b"other a\n", b"k b\n"):
        path.write_bytes(header + pickle.dumps("theirs"))
        between.stage = "a"
        assert between.once("a", lambda: "ours") == "ours"


def test_two_processes_at_once_have_temporary_files_of_their_own(path, monkeypatch) -> None:
    names, replace = [], os.replace
    monkeypatch.setattr(os, "replace", lambda source, target: (names.append(source), replace(source, target)))
    for _ in range(2):
        opened(path).once("b", lambda: 1)
        path.unlink()
    assert len(set(names)) == 2


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_an_interrupted_write_leaves_what_was_kept_before(path, monkeypatch, error) -> None:
    opened(path).once("a", lambda: 1)

    def stop(source, target) -> None:
        raise error

    monkeypatch.setattr(os, "replace", stop)
    checkpoint = opened(path)
    if error is OSError:
        assert checkpoint.once("b", lambda: 2) == 2
    else:
        with pytest.raises(KeyboardInterrupt):
            checkpoint.once("b", lambda: 2)
    assert [item.name for item in path.parent.iterdir()] == [".progress"]
    assert opened(path).once("a", fail) == 1


def test_a_stage_that_cannot_be_read_is_removed(path) -> None:
    opened(path).once("a", lambda: 1)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(KeyError):
        opened(path).once("a", lambda: {}["nothing"])
    assert not path.exists()


def test_a_file_that_cannot_be_opened_keeps_nothing(path, caplog) -> None:
    path.mkdir(parents=True)
    checkpoint = opened(path)
    assert checkpoint.stage is None
    assert "cannot be read" in caplog.text
    assert checkpoint.once("a", lambda: 1) == 1


@pytest.fixture(scope="module")
def call(bench, record):
    """The diagnosis of :func:`diagnosed`, kept in a file and perhaps interrupted at some words."""

    def make(checkpoint: Checkpoint, at: str = "", seed: int = 0, kind: str = "viscous") -> tuple[Diagnosis, list[str]]:
        heard: list[str] = []

        def tell(words: str, done: float | None) -> None:
            heard.append(words)
            if at and words.startswith(at):
                raise KeyboardInterrupt

        recordings = [record(kind, i, f"run{i}") for i in range(3)]
        kept = [record(kind, 9, "kept")]
        return diagnose(bench.xml, recordings, kept, seed=seed, nthread=1, tell=tell, checkpoint=checkpoint), heard

    return make


@pytest.mark.parametrize(
    ("at", "resumed"),
    [
        ("noise floor", None),
        ("naming on all data", "naming on a part of the data"),
        ("testing what could stand", "naming on a part of the data"),
        ("weighing", "naming"),
        ("writing", "naming"),
    ],
)
def test_an_interrupted_diagnosis_goes_on_and_finds_the_same(call, diagnosed, path, at, resumed) -> None:
    with pytest.raises(KeyboardInterrupt):
        call(Checkpoint(path), at)
    checkpoint = Checkpoint(path)
    found, heard = call(checkpoint)
    whole = diagnosed("viscous")
    assert found.to_dict() == whole.to_dict()
    assert json.dumps(found.evidence) == json.dumps(whole.evidence)
    assert found.files == whole.files
    assert checkpoint.resumed == resumed
    assert any(words.startswith("testing") for words in heard) is (resumed != "naming")
    assert checkpoint.stage == "naming"


def test_an_interruption_after_another_goes_on_from_the_later_stage(call, path) -> None:
    for at in ("naming on all data", "weighing"):
        with pytest.raises(KeyboardInterrupt):
            call(Checkpoint(path), at)
    checkpoint = Checkpoint(path)
    call(checkpoint)
    assert checkpoint.resumed == "naming"


@pytest.mark.parametrize("change", [{"seed": 1}, {"kind": "none"}])
def test_another_option_or_other_recordings_start_anew(call, path, change) -> None:
    with pytest.raises(KeyboardInterrupt):
        call(Checkpoint(path), "weighing")
    checkpoint = Checkpoint(path)
    call(checkpoint, **change)
    assert checkpoint.resumed is None


def test_other_code_of_ours_is_a_dataclass_or_nothing(path) -> None:
    """A function of the diagnosis cannot be smuggled in either."""
    checkpoint = opened(path)
    checkpoint.once("a", lambda: 1)
    head = path.read_bytes().split(b"\n")[0] + b"\n"
    path.write_bytes(head + pickle.dumps(diagnose))
    assert opened(path).once("a", lambda: 2) == 2


def test_frozen_values_come_back_equal(path, bench) -> None:
    score = Score(10, 3, 1.5, 2.0)
    fit = dataclasses.replace(bench.nominal, design=None)
    found = opened(path).once("a", lambda: (score, fit))
    assert found[0] == score
    for field in dataclasses.fields(fit):
        np.testing.assert_array_equal(getattr(found[1], field.name), getattr(fit, field.name))
