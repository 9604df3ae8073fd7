from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.controls import Controls
from torch_activegp.diagnosis.simulation.memories import Memories


@pytest.fixture
def counted(bench, monkeypatch):
    """The rotor behind a backlash, and how often its memory was made."""
    play, made = bench.effect("backlash"), []
    kind, memory = type(play), type(play).memory
    monkeypatch.setattr(kind, "memory", lambda self, *args: (made.append(1), memory(self, *args))[1])
    return play, made


def ask(bench, memories: Memories, effect, gap: float = 0.3, segments=None, **changed) -> np.ndarray:
    segments = segments or bench.segments
    candidate = Candidate((effect,), (np.array([gap]),), **changed)
    controls = Controls(segments, [candidate], 1, bench.machine.model.nu)
    rows = np.arange(segments.size)
    return memories(effect, segments, rows, np.full((len(rows), 1), gap), controls)


def test_the_same_question_is_answered_once(bench, counted) -> None:
    effect, made = counted
    memories = Memories(bench.engine.channels)
    first = ask(bench, memories, effect)
    kept = first.copy()
    first[:] = 7.0  # a simulation goes on in what it was given
    np.testing.assert_array_equal(ask(bench, memories, effect), kept)
    assert len(made) == 1


def test_another_gap_effect_or_run_is_another_question(bench, counted) -> None:
    effect, made = counted
    memories = Memories(bench.engine.channels)
    ask(bench, memories, effect)
    assert not np.array_equal(ask(bench, memories, effect, 0.2), ask(bench, memories, effect, 0.3), equal_nan=True)
    ask(bench, memories, dataclasses.replace(effect, centred=False))
    assert len(made) == 3
    runs = tuple(dataclasses.replace(run, smooth=-run.smooth) for run in bench.segments.runs)
    turned = ask(bench, memories, effect, segments=dataclasses.replace(bench.segments, runs=runs))
    assert not np.array_equal(ask(bench, memories, effect), turned)
    assert len(made) == 5


def test_each_start_is_known_by_itself(bench, counted) -> None:
    """In another order, and beside new ones: a rotor is carried no further because another one is."""
    effect, made = counted
    memories, segments = Memories(bench.engine.channels), bench.segments
    some = ask(bench, memories, effect, segments=segments.pick(np.array([3, 1])))
    whole = ask(bench, memories, effect)
    np.testing.assert_array_equal(some, whole[[3, 1]])
    np.testing.assert_array_equal(whole, ask(bench, Memories(bench.engine.channels), effect))
    back = np.arange(segments.size)[::-1]
    np.testing.assert_array_equal(ask(bench, memories, effect, segments=segments.pick(back)), whole[back])
    assert len(made) == 3


def test_few_are_kept(bench, counted, monkeypatch) -> None:
    effect, made = counted
    monkeypatch.setattr("torch_activegp.diagnosis.simulation.memories._MOST", 2 * bench.segments.size)
    memories = Memories(bench.engine.channels)
    for gap in (0.1, 0.2, 0.3, 0.1):
        ask(bench, memories, effect, gap)
    assert len(made) == 4


def test_a_control_of_the_simulations_is_none_of_what_was_before(bench, counted) -> None:
    effect, made = counted
    memories = Memories(bench.engine.channels)
    plain = ask(bench, memories, effect)
    shove = np.ones((bench.segments.size, bench.segments.intervals, bench.machine.model.nu))
    np.testing.assert_array_equal(ask(bench, memories, effect, shove=shove), plain)
    gain = bench.effect("actuator_gain", "actuator:drive")
    stronger = Candidate((effect, gain), (np.array([0.3]), np.array([-2.0])))
    controls = Controls(bench.segments, [stronger], 1, bench.machine.model.nu)
    rows = np.arange(bench.segments.size)
    found = memories(effect, bench.segments, rows, np.full((len(rows), 1), 0.3), controls)
    assert not np.array_equal(found, plain, equal_nan=True)
    assert len(made) == 2


def test_what_acts_on_no_joint_remembers_nothing(bench) -> None:
    gain = bench.effect("actuator_gain", "actuator:drive")
    rows = np.arange(bench.segments.size)
    controls = Controls(bench.segments, [Candidate((gain,), (np.array([0.1]),))], 1, bench.machine.model.nu)
    assert Memories(bench.engine.channels)(gain, bench.segments, rows, np.zeros((len(rows), 1)), controls) is None
