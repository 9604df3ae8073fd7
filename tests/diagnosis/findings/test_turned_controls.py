from __future__ import annotations

import dataclasses
import functools
import importlib
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.findings import changed_controls
from torch_activegp.diagnosis.findings import turned_controls as module
from torch_activegp.diagnosis.findings.doubts import MUCH_LEFT
from torch_activegp.diagnosis.findings.turned_controls import doubt_places, doubt_signs
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

diagnosing = importlib.import_module("torch_activegp.diagnosis.diagnose")


def turned(clean, sign: float, loud: float) -> Explanation:
    """What the model with a friction would have recorded, its control turned or not; a drag came closest."""
    wet, drag = clean.effect("viscous_friction"), clean.effect("quadratic_drag")
    truth = Candidate((wet,), (np.array([0.06]),))
    seen = clean.engine.predict(clean.segments, clean.nominal.starts[None], [truth])[0]
    noise = loud * clean.noise
    position = seen + noise * np.random.default_rng(0).normal(size=seen.shape)
    runs = tuple(dataclasses.replace(run, control=sign * run.control) for run in clean.segments.runs)
    segments = dataclasses.replace(clean.segments, runs=runs, position=position)
    shooting = Shooting(clean.engine, segments, NoiseModel.white(np.array([noise])))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    named = shooting.fit([((drag,), (np.array([0.01]),))], nominal.starts)[0]
    selection = Selection(nominal, [nominal, named], Score(shooting.samples, 60, 1.0))
    return Explanation(clean.engine, shooting, selection, (wet, drag), given=clean.engine)


@pytest.mark.parametrize(
    ("sign", "loud", "said"), [(-1.0, 0.02, True), (1.0, 0.02, False), (-1.0, 10.0, True), (-1.0, 300.0, False)]
)
def test_a_control_with_the_other_sign_is_told_though_a_friction_is_missing_too(clean, sign, loud, said: bool) -> None:
    """Where more than noise is left. The names that came closest explain less than the sign does."""
    found = doubt_signs(turned(clean, sign, loud))
    assert bool(found) == said
    if said:
        assert "Column `ctrl.drive`: the sign seems to be the other way round" in found[0]
        assert "ctrl.drive = { sign = -1 }" in found[0]


def with_names(found: Explanation, left: float) -> Explanation:
    """The same with names that leave so many times the noise."""
    nominal = found.selection.nominal
    named = dataclasses.replace(nominal, chi2=left * found.shooting.dof)
    return dataclasses.replace(found, selection=SimpleNamespace(nominal=nominal, best=named))


def in_places(clean, record, swapped: bool, loud: float) -> Explanation:
    """What a model with two motors on its joint would have recorded, with each other's columns or not."""
    motors = '<motor name="second" joint="hip" gear="-2"/><motor name="third" joint="hip"/></actuator>'
    model = mujoco.MjModel.from_xml_string(clean.xml.replace("</actuator>", motors))
    still = np.zeros(201)
    turns = [{"ctrl__second": np.sin(0.05 * k * np.arange(201)), "ctrl__third": still} for k in (1, 2)]
    machine = make_machine(model, [record("none", k, **more) for k, more in enumerate(turns)], [record("none", 9)])
    engine, segments = Engine(model, machine.channels, 2, 1), cut(machine.fit, 0.5, 0.1)
    seen = engine.predict(segments, engine.starts(segments)[None], [NOMINAL])[0]
    noise = loud * clean.noise
    position = seen + noise * np.random.default_rng(0).normal(size=seen.shape)
    columns = [1, 0, 2] if swapped else [0, 1, 2]
    runs = tuple(dataclasses.replace(run, control=run.control[:, columns]) for run in segments.runs)
    segments = dataclasses.replace(segments, runs=runs, position=position)
    shooting = Shooting(engine, segments, NoiseModel.white(np.array([noise])))
    nominal = shooting.fit([((), ())], engine.starts(segments))[0]
    selection = Selection(nominal, [nominal], Score(shooting.samples, 60, 1.0))
    return Explanation(engine, shooting, selection, (), given=engine)


@pytest.mark.parametrize(("swapped", "loud", "said"), [(True, 0.02, True), (False, 0.02, False), (True, 300.0, False)])
def test_two_controls_in_each_others_columns_are_told(clean, record, swapped, loud, said: bool) -> None:
    """Where much is left, and not much more so than by names. A third one that rests is none of them."""
    found = in_places(clean, record, swapped, loud)
    assert doubt_signs(found) == []
    told = doubt_places(found)
    assert bool(told) == said
    if said:
        (text,) = told
        assert text.startswith("Columns `ctrl.drive` and `ctrl.second` seem to be interchanged, or those of the joints")
        for line in ('ctrl.drive = { column = "ctrl.second" }', 'ctrl.second = { column = "ctrl.drive" }'):
            assert line in text
        for best, near in ((3.0, True), (0.5, False), (1e3, True)):
            assert bool(doubt_places(with_names(found, best))) is near


def test_a_control_turned_may_leave_much_where_names_leave_much_too(clean) -> None:
    found = turned(clean, -1.0, 0.02)
    (told,) = doubt_signs(found)
    left = float(told.partition("leaves ")[2].split()[0])
    assert left > 2 * MUCH_LEFT
    for best, said in ((left / 9.0, True), (left / 11.0, False), (0.9 * MUCH_LEFT, False)):
        assert bool(doubt_signs(with_names(found, best))) is said


def test_of_several_that_mend_the_one_that_leaves_least_is_told(clean, record, monkeypatch) -> None:
    found = in_places(clean, record, True, 0.02)
    monkeypatch.setattr(module, "_INTERCHANGED", 1.0)
    monkeypatch.setattr(module, "_nearest", lambda explanation, changes, rows: sorted(changes, reverse=True))
    (told,) = doubt_places(with_names(found, 1e9))
    assert told.startswith("Columns `ctrl.drive` and `ctrl.second`")


def test_of_many_changes_those_are_fitted_that_come_nearest_within_the_limits_of_their_columns(
    clean, record, monkeypatch
) -> None:
    found = in_places(clean, record, True, 0.02)
    monkeypatch.setattr(module, "_TRIED", 1)
    assert doubt_places(found)
    (least, most) = found.engine.limits
    assert not np.isfinite([least, most]).any()
    least[0], most[0] = -0.1, 0.2
    changed = changed_controls.with_controls(found, functools.partial(module._swapped, first=0, second=1))
    for before, after in zip(found.shooting.segments.runs, changed.segments.runs, strict=True):
        np.testing.assert_array_equal(after.control[:, 0], np.clip(before.control[:, 1], -0.1, 0.2))
        np.testing.assert_array_equal(after.control[:, 1], before.control[:, 0])


def test_places_of_controls_are_doubted_where_neither_rows_nor_signs_are(monkeypatch) -> None:
    monkeypatch.setattr(diagnosing, "doubt_rows", lambda explanation: [])
    monkeypatch.setattr(diagnosing, "doubt_signs", lambda explanation: [])
    monkeypatch.setattr(diagnosing, "doubt_places", lambda explanation: ["places"])
    for verdict, told in (("unknown", ["places"]), ("named", [])):
        judgement = SimpleNamespace(verdict=verdict)
        assert diagnosing._late(None, judgement, lambda words, done: None) == told
