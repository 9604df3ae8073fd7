from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.findings import stability as module
from torch_activegp.diagnosis.findings.refit import Refits, refit
from torch_activegp.diagnosis.findings.stability import _parts, is_refuted, stability
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.result import Stability
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.judge import Judgement
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.places import effects_for

ONE = ("viscous_friction",)


@pytest.fixture(scope="module")
def found_for(bench, record):
    """What becomes of effects that were named on recordings of some kinds."""

    def make(
        kinds: Sequence[str],
        names: Sequence[str] = ONE,
        verdict: str = "named",
        seconds: float = 2.0,
        left: float = 1.0,
    ) -> Stability | None:
        recordings = [record(kind, seed, f"run{seed}", seconds) for seed, kind in enumerate(kinds)]
        machine = make_machine(mujoco.MjModel.from_xml_string(bench.xml), recordings, [record("none", 9, "kept")])
        engine = Engine(machine.model, machine.channels, 2, 1)
        segments = cut(machine.fit, 0.5, 0.1)
        shooting = Shooting(engine, segments, NoiseModel.white(np.array([bench.noise])))
        nominal = shooting.fit([((), ())], engine.starts(segments))[0]
        every = {effect.name: effect for effect in effects_for(machine.model, machine.channels, machine.fit)}
        effects = tuple(every[name] for name in names)
        fit = shooting.fit([(effects, tuple(e.seeds[0] for e in effects))], nominal.starts)[0]
        selection = Selection(nominal, [nominal, fit], Score(shooting.samples, 60, left))
        some = (1.0,) * len(effects)
        judgement = Judgement(verdict, fit, effects, some, some, ((),) * len(effects), (), 0.0, True, 0.0, ())
        return stability(shooting, selection, judgement)

    return make


def test_an_effect_that_is_everywhere_stands(bench, found_for) -> None:
    found = found_for(["viscous"] * 3)
    (effect,) = found.effects
    assert found.left_out == ("run0", "run1", "run2")
    assert found.sound
    assert effect.rests_on == ()
    assert min(effect.gains) > 20.0
    spread = effect.parameters["coefficient"]
    assert spread.low < bench.viscous < spread.high or spread.low == pytest.approx(bench.viscous, rel=0.05)
    assert 0.0 < spread.shift < 2.5
    assert str(found) == (
        "Each recording left out in turn and forecast from the rest: viscous_friction at joint:hip improves 3 of 3; "
        f"no parameter moves by more than {spread.shift:.2g} standard errors."
    )


def test_an_effect_that_lives_off_one_recording_is_said_to(found_for) -> None:
    found = found_for(["none", "viscous", "none", "none"])
    (effect,) = found.effects
    assert effect.rests_on == ("run1",)
    assert [gain is None for gain in effect.gains] == [False, True, False, False]
    assert not found.sound
    assert "viscous_friction at joint:hip rests on run1 alone: the rest is not enough to name it" in found.sentence


def test_a_recording_that_contradicts_the_others_is_said_to(found_for) -> None:
    found = found_for(["viscous", "viscous", "none", "viscous"])
    (effect,) = found.effects
    assert effect.rests_on == ()
    assert effect.gains[2] < -10.0 < 20.0 < min(effect.gains[:2])
    assert effect.parameters["coefficient"].farthest == "run2"
    assert not found.sound
    assert "fitted to the rest makes the forecast of run2 worse" in found.sentence


def test_a_parameter_that_moves_far_is_said_to(found_for) -> None:
    found = found_for(["viscous", "none"], seconds=8.0)
    (effect,) = found.effects
    assert effect.rests_on == ("run0",)
    assert effect.parameters["coefficient"].shift > 2.5
    assert "standard errors without run1: more than its interval leads to expect" in found.sentence


def test_so_it_is_among_many_recordings_whose_spread_widens_the_interval(found_for) -> None:
    found = found_for(["viscous", "none", "viscous", "viscous"], seconds=8.0)
    assert found.effects[0].parameters["coefficient"].farthest == "run1"
    assert found.effects[0].parameters["coefficient"].shift > 2.5
    assert "standard errors without run1: more than its interval leads to expect" in found.sentence


def test_of_two_effects_the_one_that_does_nothing_is_told_apart(found_for) -> None:
    viscous, force = found_for(["viscous"] * 3, ("viscous_friction", "constant_force")).effects
    assert viscous.rests_on == ()
    assert force.rests_on == ("run0", "run1", "run2")
    assert force.gains == (None, None, None)
    assert force.parameters == {}


def test_one_recording_is_halved_and_that_is_said(found_for) -> None:
    found = found_for(["viscous"])
    assert found.left_out == ("the first half of run0", "the second half of run0")
    assert found.sentence.startswith("The one recording in two halves, each left out in turn")
    assert len(found.effects[0].gains) == 2


def test_halves_are_halves_of_the_time_and_not_of_the_segments(bench) -> None:
    segments = cut(bench.machine.fit[:1], 0.25, 0.1)
    segments = segments.pick(np.arange(segments.size) > 1)
    time, centers = segments.runs[0].time, segments.centers()
    _, (second, first) = _parts(segments)
    np.testing.assert_array_equal(first, centers < (time[0] + time[-1]) / 2)
    np.testing.assert_array_equal(second, ~first)
    assert first.sum() != second.sum()


@pytest.mark.parametrize("which", ["without", "with"])
def test_a_simulation_that_fails_is_not_a_part_that_says_nothing(found_for, monkeypatch, which) -> None:
    def fails(shooting, fit, kept) -> Refits:
        found = refit(shooting, fit, kept)
        if bool(fit.effects) is (which == "with"):
            found.per_segment[1, shooting.segments.run == 1] = np.inf
        return found

    monkeypatch.setattr("torch_activegp.diagnosis.findings.stability.refit", fails)
    found = found_for(["viscous"] * 3)
    (effect,) = found.effects
    if which == "without":
        assert (effect.rests_on, effect.fails_without, effect.fails_with) == ((), ("run1",), ())
        assert [gain is None for gain in effect.gains] == [False, True, False]
        assert "improves 3 of 3" in found.sentence
        assert found.sound
    else:
        assert (effect.fails_without, effect.fails_with) == ((), ("run1",))
        assert "makes the forecast of run1 worse" in found.sentence


def test_many_recordings_are_left_out_by_neighbours(found_for) -> None:
    found = found_for(["viscous"] * 14)
    assert len(found.left_out) == 12
    assert found.left_out[:3] == ("run0, run1", "run2, run3", "run4")


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_without_a_name_there_is_nothing_to_leave_out(found_for, verdict) -> None:
    assert found_for(["viscous"] * 2, verdict=verdict) is None


def test_the_diagnosis_holds_it_as_plain_values(diagnosed) -> None:
    found = diagnosed("viscous")
    read = json.loads(json.dumps(found.to_dict()))["stability"]
    assert read["left_out"] == ["run0", "run1", "run2"]
    (effect,) = read["effects"]
    assert (effect["name"], len(effect["gains"]), effect["rests_on"]) == ("viscous_friction", 3, [])
    spread = effect["parameters"]["coefficient"]
    (estimate,) = found.effects[0].parameters.values()
    assert spread["low"] <= estimate.value <= spread["high"]
    assert dataclasses.asdict(found.stability.effects[0].parameters["coefficient"]) == spread
    assert diagnosed("none").to_dict()["stability"] is None


@pytest.mark.parametrize(
    ("gains", "gain", "white", "refuted"),
    [
        ((5.0, -15.0, None), 40.0, True, True),
        ((20.0, -15.0), 40.0, True, False),  # as a whole it forecasts better
        ((-3.0, -4.0), 40.0, True, False),  # no more than chance
        ((20.0, -25.0), 90.0, True, True),  # what gains so little should improve forecasts by nearly as much
        ((20.0, -25.0), 160.0, True, False),
        ((None, -15.0), 1700.0, False, False),  # next to what it gains where it acts
        ((None, None), 40.0, True, False),  # it acts in one recording alone
        ((None, -715.0, 6.0), 1890.0, False, True),
        ((-180.0, 189.0, -121.0, 432.0, -36.0), 620.0, False, True),  # what it wins, it loses elsewhere
        ((-50.0, 189.0, -11.0, 432.0, -36.0), 620.0, False, False),
        ((None, -715.0, 6.0), 1890.0, True, False),  # so much is no chance where white noise is left
    ],
)
def test_what_refutes_an_effect(gains, gain: float, white: bool, refuted: bool) -> None:
    assert is_refuted(gains, gain, white) is refuted


@pytest.mark.parametrize(
    ("gains", "loud", "refuted"),
    [
        ((300.0,) * 10 + (-180.0, -50.0), True, True),
        ((300.0,) * 10 + (-180.0, -50.0), False, False),
        ((300.0,) * 7 + (-180.0, -9.0), True, False),  # one of them is no more than chance
        ((300.0,) * 12 + (-180.0, -50.0), True, False),
        ((300.0,) * 10 + (5.0, 9.0, None) + (-180.0, -50.0), True, True),  # where it does not act it is no better
    ],
)
def test_where_much_is_left_an_effect_must_be_told_by_recordings(gains, loud: bool, refuted: bool) -> None:
    assert is_refuted(gains, 1e4, white=False, loud=loud) is refuted


@pytest.mark.parametrize("left", [3.0, 5.0])
def test_much_is_left_from_four_times_the_noise_on(found_for, monkeypatch, left: float) -> None:
    asked = []
    monkeypatch.setattr(module, "is_refuted", lambda gains, gain, white, loud: asked.append(loud) or False)
    found_for(["viscous"] * 3, left=left)
    assert asked == [left > 4.0]
