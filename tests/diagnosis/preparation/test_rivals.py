from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.preparation import rivals
from torch_activegp.diagnosis.preparation.rivals import Rival, closest_by_one, distinct, too_far
from torch_activegp.diagnosis.simulation.engine import Engine


@pytest.fixture
def forms(clean):
    """The same model in one, two and four steps between rows."""
    return [Engine(clean.engine.model, clean.engine.channels, steps, 1) for steps in (1, 2, 4)]


def test_a_rival_is_judged_by_what_no_initial_state_takes_away(clean, forms) -> None:
    fit = clean.shooting.fit([((), ())], clean.nominal.starts)[0]
    rival = Rival.at(clean.shooting, forms[-1], fit)
    white = clean.shooting.residuals(rival.exact)
    assert 0.0 < rival.left < float((white**2).sum())
    moved = dataclasses.replace(fit, starts=fit.starts + 1e-4)
    assert Rival.at(clean.shooting, forms[-1], moved).left == pytest.approx(rival.left, rel=0.01)


def test_nor_what_a_parameter_would_take_away(bench) -> None:
    """To first order: what viscous friction explains is left to a fit without it, and not to one with hardly any."""
    without = bench.shooting.fit([((), ())], bench.nominal.starts)[0]
    hardly = bench.shooting.fit([((bench.effect("viscous_friction"),), (np.array([1e-6]),))], without.starts, rounds=0)[
        0
    ]
    assert hardly.columns is not None
    rivals = [Rival.at(bench.shooting, bench.engine, fit) for fit in (without, hardly)]
    assert [rival.left / bench.shooting.dof > 5.0 for rival in rivals] == [True, True]
    assert rivals[0].least == rivals[0].left
    assert rivals[1].least / bench.shooting.dof == pytest.approx(1.0, abs=0.3)


def test_of_rivals_that_nothing_tells_apart_the_first_is_kept(clean, forms) -> None:
    fit = clean.shooting.fit([((), ())], clean.nominal.starts)[0]
    one = Rival.at(clean.shooting, forms[0], fit)
    begun = fit.design.reshape(*one.exact.shape, -1)[..., 0] * clean.noise
    alike = dataclasses.replace(one, exact=one.exact + 5.0 * begun)  # but for other initial states
    other = dataclasses.replace(one, exact=one.exact + clean.noise * np.random.default_rng(0).normal(size=begun.shape))
    assert distinct([one, alike, other], clean.shooting, fit) == [one, other]
    assert distinct([alike, other, one], clean.shooting, fit) == [alike, other]
    rest = clean.noise * np.random.default_rng(1).normal(size=begun.shape)
    size = np.sqrt(0.5 / Rival.saying(clean.segments.position - rest, forms[0], clean.shooting, fit).left)
    hardly = dataclasses.replace(one, exact=one.exact + size * rest)  # by 0.5 of chi2: too much where something sticks
    for abrupt in (False, True):
        assert (hardly in distinct([one, hardly], clean.shooting, fit, abrupt)) is abrupt


def test_the_closest_length_of_step_is_told_better_by_one_that_is_close(clean, monkeypatch) -> None:
    """Behind a servo that is stiff for a long step, what one is off grows faster than the step."""
    fit = clean.shooting.fit([((), ())], clean.nominal.starts)[0]
    forms = [Engine(clean.engine.model, clean.engine.channels, steps, 1) for steps in (1, 4, 8, 12, 16, 20)]
    fine = Engine(clean.engine.model, clean.engine.channels, 1, 1, integrator=int(mujoco.mjtIntegrator.mjINT_EULER))
    rough = np.random.default_rng(0).normal(size=clean.segments.position.shape)

    def at(steps: int):
        return clean.segments.position + 50.0 * clean.noise * rough * (
            1.0 / steps + 0.8 / steps**2 - 1 / 12 - 0.8 / 144
        )

    said = Rival.saying
    tried = []

    def simulate(shooting, engine, fit):
        tried.append(engine.substeps)
        return said(at(engine.substeps), engine, shooting, fit)

    monkeypatch.setattr(Rival, "at", simulate)
    rivals = [said(at(10**9), fine, clean.shooting, fit), said(at(1), forms[0], clean.shooting, fit)]
    found = closest_by_one(forms[1:], rivals, fine, clean.shooting, fit)
    assert tried == [20, 12]
    assert [rival.engine.substeps for rival in found] == [20, 12]
    assert found[-1].left == pytest.approx(0.0, abs=1e-6)
    tried.clear()  # so far off, one length tells nothing: another one is simulated, though none seems to be close
    closest_by_one(forms[1:], rivals, fine, clean.shooting, fit, least=0.0)
    assert tried == [12]


def test_a_form_is_given_up_by_what_was_expected_of_the_best_one() -> None:
    """A fit gains more than is seen to first order; forms that are not fitted yet may gain as much."""
    results = [(100.0, "the best", 120.0), (110.0, "another", 500.0)]
    assert too_far(results, much=False) == pytest.approx(120.0 + rivals._BARE_BEHIND)
    assert too_far(results, much=True) == pytest.approx(100.0 * (1.0 + rivals._BEHIND) + rivals._FAR_BEHIND)
