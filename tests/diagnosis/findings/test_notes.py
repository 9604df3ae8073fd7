from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.findings.notes import forecast_notes, outcome_notes, search_notes, unknown_notes
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.score import Score


def test_nothing_is_said_of_a_search_as_it_should_be_and_all_that_is_not(bench) -> None:
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 5, 1.0))
    plain = Explanation(bench.engine, bench.shooting, selection, (), given=bench.engine)
    assert search_notes(plain, ()) == []
    some = bench.shooting.pick(np.arange(0, bench.segments.size, 2))
    short = dataclasses.replace(selection, cut_short=True)
    found = Explanation(bench.engine, some, short, (), given=bench.engine)
    part, end = search_notes(found, ())
    assert "47% of the recordings" in part
    assert "15 million time steps" in end
    assert "on a part of the data" not in end
    vain = dataclasses.replace(found, selection=dataclasses.replace(short, in_vain=True))
    told = search_notes(vain, ())[-1]
    assert "on a part of the data left much more than noise" in told
    assert "million" not in told


def test_what_was_not_sought_on_a_joint_that_does_not_turn_back_is_told(bench) -> None:
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 5, 1.0))

    def notes(*lacking: str) -> list[str]:
        effects = tuple(effect for effect in bench.effects if effect.name not in lacking)
        found = Explanation(bench.engine, bench.shooting, selection, effects, given=bench.engine)
        return search_notes(found, ())

    assert notes() == []
    (both,) = notes("hysteresis", "asymmetric_friction")
    assert both.startswith("joint:hip hardly turns back") and "hysteresis and friction that differs between" in both
    (one,) = notes("hysteresis")
    assert "friction that differs" not in one


def test_an_encoder_that_turns_out_to_sit_on_the_motor_is_told(bench) -> None:
    for variant, told in (("motor side", True), ("", False)):
        play = next(effect for effect in bench.effects if (effect.name, effect.variant) == ("backlash", variant))
        fit = dataclasses.replace(bench.nominal, effects=(play,), values=(np.array([0.1]),), chi2=0.0)
        selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 5, 1.0))
        found = Explanation(bench.engine, bench.shooting, selection, tuple(bench.effects), given=bench.engine)
        notes = search_notes(found, fit.effects)
        assert [note.startswith("joint:hip: the recordings agree with an encoder") for note in notes] == [True] * told
        assert search_notes(found, ()) == []  # the best set, but nothing is named


@pytest.mark.parametrize("density", [0.0, 0.3])
@pytest.mark.parametrize("named", [True, False])
def test_a_rest_that_counts_as_process_noise_is_told(bench, density: float, named: bool) -> None:
    """In units of the noise of positions, of the model that is given."""
    fit = bench.fit("viscous_friction", 0.1)
    noise = dataclasses.replace(bench.shooting.noise, process=np.array([density]))
    selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 5, 1.0))
    shooting = dataclasses.replace(bench.shooting, noise=noise)
    found = Explanation(bench.engine, shooting, selection, tuple(bench.effects), given=bench.engine)
    notes = search_notes(found, fit.effects if named else ())
    told = [note for note in notes if "process noise" in note]
    assert len(told) == (density > 0.0)
    left = (fit if named else bench.nominal).chi2 / bench.shooting.dof
    for note in told:
        assert note.startswith("joint:hip") and "0.3 rad/s2/sqrt(Hz)" in note
        assert float(note.split(" leaves ")[1].split()[0]) == pytest.approx(left, rel=0.02)


def test_what_may_be_a_time_step_is_told(bench) -> None:
    fit = bench.shooting.fit(
        [((bench.effect("viscous_friction"), bench.effect("armature_error")), (np.array([0.05]), np.array([1e-3])))],
        bench.nominal.starts,
    )[0]
    selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 5, 1.0))
    found = Explanation(bench.engine, bench.shooting, selection, tuple(bench.effects), given=bench.engine)
    assert search_notes(found, fit.effects) == []
    selection.of_a_step = frozenset(fit.effects[1:])
    (note,) = search_notes(found, fit.effects)
    assert note.startswith("armature_error at joint:hip: fitted along and not named")
    assert search_notes(found, ()) == []


@pytest.mark.parametrize(("left", "far"), [(99.0, False), (101.0, True)])
def test_after_unknown_it_is_said_where_to_look_and_where_nothing_comes_near_at_units_first(
    bench, left: float, far: bool
) -> None:
    best = dataclasses.replace(bench.nominal, chi2=left * bench.shooting.dof)
    selection = Selection(best, [best], Score(bench.shooting.samples, 5, 1.0))
    (note,) = unknown_notes(Explanation(bench.engine, bench.shooting, selection, (), given=bench.engine))
    assert "signs and units of each column" in note
    assert "rows_late" in note
    assert note.startswith("All that was tried leaves 101 times the noise") is far
    assert ("slips of ten" in note) is far


@pytest.mark.parametrize(("left", "ahead", "said"), [(1.1, 26.0, True), (1.1, 9.0, False), (2.5, 26.0, False)])
def test_it_is_said_where_held_out_runs_are_forecast_far_worse_than_pieces_are_fitted(bench, left, ahead, said):
    holdout = {"one_step": {"after": 0.01 * ahead, "noise": 0.01}}
    notes = forecast_notes(left, holdout, bench.shooting, bench.machine.model)
    assert len(notes) == said
    assert not said or ("with 26 times the noise" in notes[0] and "1.1 times the noise (chi2 per dof)" in notes[0])
    found = Explanation(
        bench.engine, bench.shooting, Selection(bench.nominal, [bench.nominal], None), (), given=bench.engine
    )
    assert outcome_notes(found, "none", left, holdout, bench.machine.model) == notes


def test_what_no_recording_holds_makes_forecasts_by_one_step_say_little(bench) -> None:
    two = (
        "<mujoco><worldbody><body><joint name='hip'/><geom size='0.1'/><body><joint name='knee'/><geom size='0.1'/>"
        "</body></body></worldbody></mujoco>"
    )
    holdout = {"one_step": {"after": 0.4, "noise": 0.01}}
    (note,) = forecast_notes(1.0, holdout, bench.shooting, mujoco.MjModel.from_xml_string(two))
    assert "positions of knee are not recorded" in note
    assert "0.4 s of the others" in note
