"""Recordings of a pendulum with dry friction that its model lacks, with and without a static excess."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.static_friction import try_static_friction
from torch_activegp.diagnosis.selection.ties import as_part
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.bristles import BRISTLES
from torch_activegp.physics.soft_friction import SOFT

LEVEL = 0.3


def compared(bench, law, values, noise: float):
    """The likelihood of what a law makes of the runs, and Coulomb's friction beside nothing."""
    segments, dry = bench.segments, bench.effect("coulomb_friction")
    made = bench.predict(Candidate((law,), (np.array(values),)))
    made = made + noise * np.random.default_rng(3).normal(size=made.shape)
    segments = dataclasses.replace(segments, position=made)
    shooting = dataclasses.replace(bench.shooting, segments=segments, noise=NoiseModel.white(np.array([noise])))
    nothing, found = shooting.fit([((), ()), ((dry,), (np.array([LEVEL]),))], bench.nominal.starts)
    score = Score(shooting.samples, 40, 1.0)
    return shooting, Selection(nothing, [nothing, found], score), dry


@pytest.mark.parametrize(("noise", "told"), [(1e-4, True), (2e-2, False)])
def test_where_a_static_friction_does_not_show_either_law_may_be_there(bench, noise: float, told: bool) -> None:
    shooting, selection, dry = compared(bench, bench.effect("coulomb_friction"), [LEVEL], noise)
    assert as_part(shooting, selection, dry) == ()
    try_static_friction(shooting, selection, bench.effects)
    assert selection.best.effects == (dry,)
    assert as_part(shooting, selection, dry) == (() if told else (("stribeck_friction", "joint:hip"),))


def test_a_static_friction_that_shows_is_found_from_where_it_usually_is(bench) -> None:
    law = bench.effect("stribeck_friction")
    _, usual = law.usual(LEVEL)
    shooting, selection, dry = compared(bench, law, usual, 1e-4)
    try_static_friction(shooting, selection, bench.effects)
    assert selection.best.effects == (law,)
    assert selection.best.chi2 < 0.5 * selection.of([dry]).chi2
    np.testing.assert_allclose(selection.best.values[0][:2], usual[:2], rtol=0.05)


def test_a_friction_that_the_model_softens_is_compared_with_the_firm_law(bench) -> None:
    shooting, selection, dry = compared(bench, bench.effect("coulomb_friction"), [LEVEL], 2e-2)
    (soft,) = (e for e in bench.effects if e.key == dry.key and e.variant == SOFT)
    found = dataclasses.replace(selection.best, effects=(soft,))
    selection.fits = [selection.nominal, found]
    try_static_friction(shooting, selection, bench.effects)
    assert [fit.effects[0].name for fit in selection.held] == ["stribeck_friction"] * 2


def test_nothing_is_tried_beside_other_names_or_at_rest(bench) -> None:
    shooting, selection, dry = compared(bench, bench.effect("coulomb_friction"), [LEVEL], 1e-3)
    wet = dataclasses.replace(selection.best, effects=(bench.effect("viscous_friction"),))
    still = dataclasses.replace(selection.best, at_rest=True)
    for best in (wet, still, selection.nominal):
        other = dataclasses.replace(selection, fits=[selection.nominal, best])
        try_static_friction(shooting, other, bench.effects)
        assert other.fits == [selection.nominal, best]
        assert not other.held
    try_static_friction(shooting, selection, [dry])
    assert len(selection.fits) == 2


def test_a_friction_of_bristles_keeps_them(bench) -> None:
    shooting, selection, dry = compared(bench, bench.effect("coulomb_friction"), [LEVEL], 5e-3)
    (bristled,) = (e for e in bench.effects if e.key == dry.key and e.variant == BRISTLES)
    stiffness, damping = bristled.seeds[0][1:] * 1.5
    (found,) = shooting.fit([((bristled,), (np.array([LEVEL, stiffness, damping]),))], selection.best.starts, hold=True)
    selection.fits = [selection.nominal, found]
    try_static_friction(shooting, selection, bench.effects)
    assert [fit.effects[0].variant for fit in selection.held] == [BRISTLES] * 2
    for fit in selection.held:
        np.testing.assert_allclose(fit.values[0][3:], [stiffness, damping])
