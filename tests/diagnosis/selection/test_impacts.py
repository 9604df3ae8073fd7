from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.against_a_stop import AT, DAMPING, STIFFNESS, struck_bench
from torch_activegp.diagnosis.selection import impacts as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.impacts import _is_astray, behind_impacts, led_back, with_stops_further_in
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score


def test_the_best_of_new_sets_are_chained_where_a_machine_strikes(bench, monkeypatch) -> None:
    """The right one may leave more than a wrong one there, in a single segment."""
    wet, drag, push = (bench.fit(name, 0.02) for name in ("viscous_friction", "quadratic_drag", "constant_force"))
    chosen = Selection(bench.nominal, [bench.nominal, push, wet, drag], Score(bench.shooting.samples, 60, 1.0))
    better = dataclasses.replace(drag, chi2=wet.chi2 - 50.0)
    asked: list = []
    monkeypatch.setattr(module, "chained", lambda _, fit: asked.append(fit) or (better if fit is drag else fit))
    touches = np.arange(300) < 6
    monkeypatch.setattr("torch_activegp.diagnosis.simulation.touching.poses_that_touch", lambda *_: (touches, touches))
    new = [frozenset(fit.effects) for fit in (wet, drag)]
    behind_impacts(chosen, bench.shooting, new)
    assert asked == [wet, drag]  # the push is not new
    assert chosen.best is better
    assert len(chosen.fits) == 5
    asked.clear()
    behind_impacts(chosen, bench.shooting, new, bench.shooting.work)  # no time is left
    touches &= False
    behind_impacts(chosen, bench.shooting, new)  # nothing is struck
    assert asked == []


@pytest.fixture
def long(bench):
    """Eleven segments, of which a tenth is one."""
    shooting = bench.shooting.pick(np.arange(11) % bench.segments.size)
    nominal = shooting.fit([((), ())], shooting.engine.starts(shooting.segments))[0]
    return shooting, shooting.fit(
        [((bench.effect("viscous_friction"),), (np.ones(1) * bench.viscous,))], nominal.starts
    )[0]


@pytest.fixture
def touching(monkeypatch):
    places = np.arange(300) < 6
    monkeypatch.setattr("torch_activegp.diagnosis.simulation.touching.poses_that_touch", lambda *_: (places, places))
    return places


def stray(long, effect, where: list[int]):
    """A rival of which some segments begin elsewhere, with a parameter that is far off, and as it stands."""
    shooting, best = long
    starts = best.starts.copy()
    starts[where, 0] += 0.05
    held = shooting.fit([((effect,), (0.5 * best.values[0],))], best.starts, hold=True)[0]
    there = shooting.fit([((effect,), (0.5 * best.values[0],))], starts, rounds=0)[0]
    level = best.per_segment + 3.0
    level[where] = there.per_segment[where]
    return dataclasses.replace(held, starts=starts, per_segment=level, chi2=float(level.sum()))


def test_a_rival_that_one_impact_led_astray_is_led_back(bench, long, touching, monkeypatch) -> None:
    shooting, best = long
    rival = stray(long, best.effects[0], [3])
    asked, fit = list[np.ndarray](), Shooting.fit
    monkeypatch.setattr(Shooting, "fit", lambda self, *a, **k: asked.append(self.segments.first) or fit(self, *a, **k))
    (found,) = led_back(shooting, best, [rival], 1e9)
    assert found.values[0] == pytest.approx(best.values[0], rel=1e-3)
    assert found.chi2 == pytest.approx(best.chi2, abs=0.5)
    first, whole = asked
    np.testing.assert_array_equal(first, np.delete(shooting.segments.first, 3))
    assert len(whole) == 11


def test_only_rivals_that_few_segments_hold_back_are_led_back(bench, long, touching) -> None:
    shooting, best = long
    rival = stray(long, best.effects[0], [3])
    everywhere = stray(long, best.effects[0], [1, 3, 5, 7, 9])
    behind = rival.chi2 - best.chi2
    near = dataclasses.replace(rival, per_segment=best.per_segment + 10.0 * (np.arange(11) == 3), chi2=best.chi2 + 10.0)
    still = dataclasses.replace(rival, at_rest=True)
    push = bench.effect("constant_force")
    more = dataclasses.replace(rival, effects=(*best.effects, push), values=(*best.values, np.zeros(1)))
    assert led_back(shooting, best, [everywhere, near, still, more], 1e9) == []
    assert led_back(shooting, best, [rival], best.chi2 + 3.9 * behind) == []  # too far off
    assert len(led_back(shooting, best, [rival], best.chi2 + 4.1 * behind)) == 1
    touching &= False
    assert led_back(shooting, best, [rival], 1e9) == []  # nothing is struck


@pytest.mark.parametrize("size", [1, 9])
def test_where_there_are_not_ten_segments_none_is_left_out(long, touching, size: int) -> None:
    shooting, best = long
    rival = stray(long, best.effects[0], [0]).pick(np.arange(size))
    assert led_back(shooting.pick(np.arange(size)), best.pick(np.arange(size)), [rival], 1e9) == []


def test_what_strikes_may_be_an_effect(bench, long) -> None:
    shooting, best = long
    rival = stray(long, best.effects[0], [3])
    stop = bench.effect("joint_stop")
    hits = dataclasses.replace(rival, effects=(stop,), values=(stop.seeds[0],))
    assert _is_astray(shooting, hits, best, 1e9)
    assert not _is_astray(shooting, rival, best, 1e9)


@pytest.fixture(scope="module")
def struck():
    """With thirty times the noise, in its model alone."""
    made = struck_bench()
    noise = dataclasses.replace(made.shooting.noise, scale=30.0 * made.shooting.noise.scale)
    shooting = dataclasses.replace(made.shooting, noise=noise)
    nominal = shooting.fit([((), ())], made.nominal.starts)[0]
    return dataclasses.replace(made, shooting=shooting, nominal=nominal)


def stop_of(struck):
    return next(effect for effect in struck.effects if effect.name == "joint_stop" and effect.variant == "upper")


def test_a_stop_that_only_some_segments_reach_is_sought_further_in(struck) -> None:
    """What does not reach it says nothing of it to first order."""
    stop, shooting = stop_of(struck), struck.shooting
    deep = shooting.fit([((stop,), (np.array([200.0, DAMPING, 0.64]),))], struck.nominal.starts)[0]
    assert deep.chi2 > 100.0 * shooting.dof
    found = with_stops_further_in(shooting, deep)
    assert found.chi2 < 0.1 * shooting.dof
    np.testing.assert_allclose(found.values[0], [STIFFNESS, DAMPING, AT], rtol=0.03)
    assert with_stops_further_in(shooting, found) is found  # nothing stands out
    assert with_stops_further_in(shooting, struck.nominal) is struck.nominal


def test_a_stop_stays_where_it_is_no_better_further_in(struck, monkeypatch) -> None:
    stop = stop_of(struck)
    fit = struck.shooting.fit([((stop,), (np.array([200.0, DAMPING, 0.64]),))], struck.nominal.starts, rounds=0)[0]
    worse = dataclasses.replace(fit, chi2=fit.chi2 + 1.0)
    monkeypatch.setattr(Shooting, "fit", lambda *_, **__: [worse])
    monkeypatch.setattr(module, "chained", lambda _, end: end)
    assert with_stops_further_in(struck.shooting, fit) is fit


def test_fits_with_a_stop_further_in_end_when_so_much_was_computed(struck, monkeypatch) -> None:
    stop, asked = stop_of(struck), list[float]()
    fit = struck.shooting.fit([((stop,), (np.array([200.0, DAMPING, 0.64]),))], struck.nominal.starts, rounds=0)[0]
    monkeypatch.setattr(Shooting, "fit", lambda *_, work, **__: asked.append(work) or [fit])
    monkeypatch.setattr(module, "chained", pytest.fail)
    with_stops_further_in(struck.shooting, fit, struck.shooting.work)
    assert asked == [struck.shooting.work]


def test_of_new_sets_with_a_stop_the_smallest_one_is_tried_with_it_elsewhere(struck, monkeypatch) -> None:
    """Where another place is what is wrong, further effects stood for that. A play is not sought further in."""
    stop, wet, play = stop_of(struck), *(struck.effect(name) for name in ("viscous_friction", "backlash"))
    values, starts, most = np.array([200.0, DAMPING, 0.64]), struck.nominal.starts, struck.nominal.chi2
    sets = [((stop, wet), (values, np.array([0.1]))), ((stop,), (values,)), ((play,), (play.seeds[0],))]
    fits = [struck.shooting.fit([some], starts, rounds=0, hold=True)[0] for some in sets]
    pair, alone, gap = (dataclasses.replace(f, chi2=s * most) for f, s in zip(fits, (0.5, 0.8, 0.85), strict=True))
    best = dataclasses.replace(alone, chi2=0.1 * most)

    def fresh(*more) -> Selection:
        every = [struck.nominal, pair, alone, gap, *more]
        return Selection(struck.nominal, every, Score(struck.shooting.samples, 60, 1.0))

    tried: list = []
    chosen, new = fresh(), [frozenset(fit.effects) for fit in (pair, alone, gap)]
    assert chosen.best is pair
    monkeypatch.setattr(module, "chained", lambda _, fit: fit)
    monkeypatch.setattr(module, "with_stops_further_in", lambda _, fit, work: tried.append(fit) or best)
    behind_impacts(chosen, struck.shooting, new)
    assert tried == [alone]
    assert chosen.best.chi2 == best.chi2
    behind_impacts(fresh(), struck.shooting, new[:1])
    assert tried.pop() is pair
    behind_impacts(fresh(), struck.shooting, new[2:])
    behind_impacts(fresh(), struck.shooting, [])
    behind_impacts(fresh(), struck.shooting, new, struck.shooting.work)
    still = dataclasses.replace(alone, chi2=0.1 * most, at_rest=True)  # given up where it does nothing
    behind_impacts(fresh(still), struck.shooting, new[1:2])
    assert tried == [alone]
