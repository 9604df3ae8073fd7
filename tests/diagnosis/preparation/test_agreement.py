from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.preparation import agreement
from torch_activegp.diagnosis.preparation.agreement import first_close
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine


@pytest.fixture
def forms(clean):
    """The same model in one, two and four steps between rows."""
    return [Engine(clean.engine.model, clean.engine.channels, steps, 1) for steps in (1, 2, 4)]


def test_what_takes_longer_steps_than_a_form_that_is_not_close_is_not_tried(clean, forms, monkeypatch) -> None:
    tried = []

    def listen(working, judged, exact, carried):
        tried.append(working.engine)
        return False

    monkeypatch.setattr(agreement, "is_close", listen)
    few, some, many = forms
    precise = dataclasses.replace(clean.shooting, engine=many)
    for order, wanted in (((some, few, many), [some]), ((few, some, many), [few, some])):
        tried.clear()
        working, judged = first_close(precise, order, clean.nominal, None)
        assert tried == wanted
        assert working.engine is many and working.offset is None
        assert np.isfinite(judged.chi2)
    leap = Engine(clean.engine.model, clean.engine.channels, 1, 1, late=True)  # another scheme says nothing of it
    tried.clear()
    first_close(precise, (some, leap, many), clean.nominal, None)
    assert tried == [some, leap]


def test_where_nothing_is_close_the_precise_fit_is_taken_as_it_is(clean, forms, monkeypatch) -> None:
    monkeypatch.setattr(agreement, "is_close", lambda *_: False)
    few, _, many = forms  # four times the steps
    precise = dataclasses.replace(clean.shooting, engine=many)
    exact = precise.fit([((), ())], clean.nominal.starts)[0]
    before = many.work
    working, judged = first_close(precise, (few, many), exact, exact)
    assert working is precise and judged is exact
    once = pytest.approx(many.steps_in(clean.segments), rel=0.02)
    assert many.work - before == once  # the correction of the other form alone


@pytest.mark.parametrize("steps", [2, 6])
def test_a_form_that_saves_little_is_not_fitted_where_the_precise_one_was(clean, forms, monkeypatch, steps) -> None:
    tried = []
    monkeypatch.setattr(agreement, "is_close", lambda working, *_: tried.append(working.engine) or True)
    few = forms[0]
    many = Engine(clean.engine.model, clean.engine.channels, steps, 1)
    precise = dataclasses.replace(clean.shooting, engine=many)
    exact = precise.fit([((), ())], clean.nominal.starts)[0]
    working, judged = first_close(precise, (few, many), exact, exact)
    assert tried == ([few] if steps == 6 else [])
    assert (working is precise and judged is exact) == (steps == 2)
    assert first_close(precise, (few, many), exact, None)[0].engine is few


@pytest.mark.parametrize(("own", "fits"), [(True, 1), (False, 2)])
def test_a_form_that_stands_for_itself_is_fitted_once(clean, forms, monkeypatch, own, fits) -> None:
    """It has no correction that could be taken anew where its fit has ended."""
    few, _, many = forms
    count, fit = [], Shooting.fit
    monkeypatch.setattr(agreement, "chained", lambda _, judged, *__: judged)
    monkeypatch.setattr(Shooting, "fit", lambda *a, **k: count.append(1) or fit(*a, **k))
    far = dataclasses.replace(clean.nominal, chi2=1e6)
    agreement.settled(dataclasses.replace(clean.shooting, engine=many if own else few), many, far)
    assert len(count) == fits


@pytest.mark.parametrize(("away", "close"), [(0.0, True), (0.001, True), (0.5, False)])
def test_a_correction_must_hold_where_the_recordings_begin_too(clean, forms, monkeypatch, away, close) -> None:
    many = forms[-1]
    model = mujoco.MjModel.from_xml_string(clean.xml.replace("RK4", "Euler"))
    cheap = Engine(model, clean.engine.channels, 1, 1)
    precise = dataclasses.replace(clean.shooting, engine=many)
    fit = precise.fit([((), ())], clean.nominal.starts)[0]
    working = dataclasses.replace(precise, engine=cheap).corrected(many, fit)
    monkeypatch.setattr(cheap, "starts", lambda segments: fit.starts + away)
    error = agreement.drift(working, precise, fit) / working.dof
    assert (error < 0.01) == close
    assert agreement.is_close(working, fit, many) == close
    assert agreement.is_close(working, fit, many, carried=True)
    assert away or error == 0.0
    far = dataclasses.replace(fit, chi2=1e9 * working.dof)  # beside what is missing it does not count
    assert agreement.is_close(working, far, many)


@pytest.mark.parametrize(("who", "far"), [("cheap", True), ("precise", True), ("both", False)])
def test_forms_of_which_one_alone_fails_are_far_apart(clean, forms, monkeypatch, who: str, far: bool) -> None:
    few, _, many = forms
    precise = dataclasses.replace(clean.shooting, engine=many)
    fit = precise.fit([((), ())], clean.nominal.starts)[0]
    working = dataclasses.replace(precise, engine=few).corrected(many, fit)
    predicted = Shooting.predicted
    lost = {"cheap": [few], "precise": [many], "both": [few, many]}[who]

    def fails(shooting: Shooting, other) -> np.ndarray:
        out = predicted(shooting, other)
        if any(shooting.engine is engine for engine in lost) and other is not fit:
            out[3] = np.nan
        return out

    monkeypatch.setattr(Shooting, "predicted", fails)
    assert np.isinf(agreement.drift(working, precise, fit)) == far
    assert agreement.is_close(working, fit, many) != far


def test_what_is_not_recorded_stays_where_the_fit_has_it(clean, forms) -> None:
    bias = clean.effect("sensor_bias", "sensor:hip")
    precise = dataclasses.replace(clean.shooting, engine=forms[-1])
    fit = precise.fit([((bias,), (np.array([0.2]),))], clean.nominal.starts, hold=True)[0]
    states = agreement._as_recorded(precise, fit)
    nq = clean.engine.model.nq
    np.testing.assert_allclose(states[:, :nq], precise.engine.starts(precise.segments)[:, :nq] - 0.2, atol=1e-9)
