from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.ram import ram
from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.brief_pieces import begun, brief, closest, left_in_brief, seconds_of
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.shooting.likelihood import Shooting

NOISE = 5e-5


def leaning(parts: int) -> Machine:
    """A ram that leans on a wall half of the time, simulated in so many parts of its model's steps."""
    return ram(step=0.01, soft=0.02, noise=NOISE, rows=801, push=6.0, truth=0.01 / parts)


@pytest.fixture(scope="module")
def finer():
    return leaning(5)


NOISES = NoiseModel.white(np.array([NOISE]))


@pytest.mark.parametrize("parts", [1, 5])
def test_the_form_that_made_the_recordings_is_closest_where_something_touches(parts) -> None:
    machine = leaning(parts)
    forms = Numerics.of(machine, 1)
    assert forms.stiff
    found = closest(forms, machine, NOISES)
    assert found.substeps in {1: {1}, 5: {4, 5}}[parts]  # the cheapest of those that are close
    assert found is forms.coarse or found in forms.own


def test_rows_far_apart_say_nothing_of_the_form(finer) -> None:
    forms = Numerics.of(finer, 1)
    slow = dataclasses.replace(finer, fit=[dataclasses.replace(run, time=2.0 * run.time) for run in finer.fit])
    assert seconds_of(slow.fit) == pytest.approx(0.24)
    assert brief(slow.fit) is None
    assert closest(forms, slow, NOISES) is forms.coarse


def test_segments_begin_where_brief_pieces_lead_across_impacts(finer) -> None:
    forms = Numerics.of(finer, 1)
    form = next(form for form in forms.own if form.substeps == 5)
    shooting = Shooting(form, cut(finer.fit, 1.0, 0.0), NOISES)
    smooth, fitted = (
        shooting.fit([((), ())], starts, rounds=2)[0] for starts in (form.starts(shooting.segments), begun(shooting))
    )
    assert fitted.chi2 < 2.0 * shooting.dof
    assert smooth.chi2 > 5.0 * fitted.chi2


def test_a_piece_across_an_impact_does_not_decide_between_forms(finer) -> None:
    forms = Numerics.of(finer, 1)
    shooting = Shooting(forms.given, cut(finer.fit, 0.25, 0.0), NOISES)
    run = finer.fit[0]
    first = int(shooting.segments.first[3])
    moved = run.position.copy()
    moved[first : first + 12] += 0.1 * np.sin(np.arange(12))[:, None]
    spoiled = dataclasses.replace(shooting.segments, runs=(dataclasses.replace(run, position=moved),))
    one, other = (
        left_in_brief(shooting, forms.own[-1]),
        left_in_brief(dataclasses.replace(shooting, segments=spoiled), forms.own[-1]),
    )
    assert other == pytest.approx(one, rel=0.1)
    assert left_in_brief(shooting, forms.given) > 2.0 * one


def test_effects_are_held_while_forms_are_compared(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    bare, behind = left_in_brief(bench.shooting, bench.engine), left_in_brief(bench.shooting, bench.engine, fit)
    assert behind < bare
    wrong = dataclasses.replace(fit, values=(np.array([5.0]),))
    assert left_in_brief(bench.shooting, bench.engine, wrong) > 2.0 * bare
