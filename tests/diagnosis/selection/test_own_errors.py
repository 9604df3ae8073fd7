from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import own_errors as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.own_errors import by_their_own_errors
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.engine import IMPLICIT_FAST, Engine


@pytest.fixture
def forms(bench):
    """The likelihoods by Runge-Kutta, and by one implicit step from row to row."""
    model, channels = bench.engine.model, bench.engine.channels
    cheap = Engine(model, channels, 1, 1, IMPLICIT_FAST)
    return bench.shooting, dataclasses.replace(bench.shooting, engine=cheap)


def test_each_of_the_best_sets_is_compared_by_what_the_cheap_form_is_off_behind_itself(bench, forms, monkeypatch):
    """A correction made behind a friction is not that of a machine that is late, or weak."""
    monkeypatch.setattr(module, "_NEAR", 1e3)
    precise, cheap = forms
    wet, late = bench.effect("viscous_friction"), bench.effect("actuator_delay", "actuator:drive")
    sets = [
        ((wet,), (np.array([0.06]),)),
        ((late,), (np.array([0.005]),)),
        ((wet, late), (np.array([0.06]), np.ones(1))),
    ]
    exact = [precise.fit([some], bench.nominal.starts)[0] for some in sets]
    working = cheap.corrected(precise.engine, exact[0])
    fits = [working.fit([(fit.effects, fit.values)], fit.starts)[0] for fit in exact]
    twice = dataclasses.replace(fits[1], chi2=fits[1].chi2 - 1.0)  # of the same set
    selection = Selection(bench.nominal, [bench.nominal, *fits, twice], Score(precise.samples, 10, 1.0))
    told = by_their_own_errors(working, precise.engine, selection)
    off = [abs(fit.chi2 - right.chi2) for fit, right in zip(fits, exact, strict=True)]
    left = [abs(selection.of(fit.effects).chi2 - right.chi2) for fit, right in zip(fits, exact, strict=True)]
    assert left[1] < 0.2 * off[1] and left[1] > 0.0
    assert max(left) < 1.0
    assert len(selection.fits) == 4 and bench.nominal in selection.fits
    assert told.engine is cheap.engine
    right = (precise.predicted(selection.best) - cheap.predicted(selection.best))[0]
    assert told.offset[0] == pytest.approx(right, abs=1e-6)


def test_what_fails_or_is_far_behind_stays_as_it_is_and_so_does_what_needs_no_correction(bench, forms, monkeypatch):
    precise, cheap = forms
    wet, drag = bench.fit("viscous_friction", 0.06), bench.fit("quadratic_drag", 0.01)
    asked: list = []
    monkeypatch.setattr(
        module, "settled", lambda s, _, fit: asked.append(fit) or (s, dataclasses.replace(fit, chi2=np.inf))
    )
    selection = Selection(bench.nominal, [bench.nominal, wet, drag], Score(precise.samples, 10, 1.0))
    before = list(selection.fits)
    assert by_their_own_errors(precise, precise.engine, selection) is precise
    assert asked == []
    working = cheap.corrected(precise.engine, wet)
    assert by_their_own_errors(working, precise.engine, selection) is working
    assert asked == [wet]
    assert selection.fits == before


@pytest.mark.parametrize(("lost", "kept"), [("viscous_friction", True), ("quadratic_drag", False)])
def test_a_set_that_is_lost_by_its_own_correction_stays_and_all_do_where_it_is_the_best(
    bench, forms, monkeypatch, lost: str, kept: bool
) -> None:
    """States behind an impact are not found again."""
    monkeypatch.setattr(module, "_NEAR", 1.0)
    precise, cheap = forms
    wet, drag = bench.fit("viscous_friction", 0.06), bench.fit("quadratic_drag", 0.01)
    drag = dataclasses.replace(drag, chi2=1.1 * wet.chi2)
    selection = Selection(bench.nominal, [bench.nominal, wet, drag], Score(precise.samples, 10, 1.0))
    working = cheap.corrected(precise.engine, wet)

    def fit_again(shooting, _, fit):
        times = 2.1 if fit.effects[0].name == lost else 0.9
        return working, dataclasses.replace(fit, chi2=times * fit.chi2)

    monkeypatch.setattr(module, "settled", fit_again)
    by_their_own_errors(working, precise.engine, selection)
    assert (wet in selection.fits) is kept
    assert drag in selection.fits


@pytest.mark.parametrize(
    ("gains", "fell"), [((5.0, 3.0, 0.5), 8.0), ((0.5, 9.0), 0.0), ((5.0,) * 5, 15.0), ((-3.0, 9.0), 0.0)]
)
def test_a_correction_is_taken_anew_while_a_close_set_gets_better_by_it(bench, forms, monkeypatch, gains, fell) -> None:
    """Behind a dry friction one correction is not enough; what is far behind is not asked again."""
    monkeypatch.setattr(module, "_NEAR", 1.0)
    precise, cheap = forms
    wet, drag = bench.fit("viscous_friction", 0.06), bench.fit("quadratic_drag", 0.01)
    drag = dataclasses.replace(drag, chi2=wet.chi2 + 40.0)
    selection = Selection(bench.nominal, [bench.nominal, wet, drag], Score(precise.samples, 10, 1.0))
    working, left = cheap.corrected(precise.engine, wet), [0.0, *gains]

    def fit_again(shooting, _, fit):
        gain = left.pop(0) if fit.effects == wet.effects else 0.0 if fit is drag else 9.0
        return shooting, dataclasses.replace(fit, chi2=fit.chi2 - gain)

    monkeypatch.setattr(module, "settled", fit_again)
    by_their_own_errors(working, precise.engine, selection)
    assert selection.of(wet.effects).chi2 == pytest.approx(wet.chi2 - fell)
    assert selection.of(drag.effects).chi2 == drag.chi2


@pytest.mark.parametrize(("other", "chosen"), [(1.05, ""), (1.2, "soft")])
def test_another_form_of_the_best_names_is_compared_by_its_own_correction_too(
    bench, forms, monkeypatch, other: float, chosen: str
) -> None:
    """The soft form had the firm one's correction."""
    precise, cheap = forms
    firm = bench.fit("coulomb_friction", 0.03)
    (soft,) = (e for e in bench.effects if e.key == firm.effects[0].key and e.variant == "soft")
    best = dataclasses.replace(firm, effects=(soft,))
    firm = dataclasses.replace(firm, chi2=other * best.chi2)
    selection = Selection(bench.nominal, [bench.nominal, best, firm], Score(precise.samples, 10, 1.0))
    assert selection.best is best
    working, asked = cheap.corrected(precise.engine, best), []

    def fit_again(shooting, _, fit):
        asked.append(fit.effects[0].variant)
        return working, dataclasses.replace(fit, chi2=(1.3 if fit.effects == (soft,) else 1.0) * fit.chi2)

    monkeypatch.setattr(module, "settled", fit_again)
    by_their_own_errors(working, precise.engine, selection)
    assert selection.best.effects[0].variant == chosen
    assert set(asked) == ({"soft", ""} if not chosen else {"soft"})
