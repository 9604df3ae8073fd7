from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.against_a_stop import AT, DAMPING, STIFFNESS, struck_bench
from torch_activegp.diagnosis.selection import impacts as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.impacts import behind_impacts, struck_elsewhere
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


@pytest.fixture(scope="module")
def struck():
    """With thirty times the noise, in its model alone."""
    made = struck_bench()
    noise = dataclasses.replace(made.shooting.noise, scale=30.0 * made.shooting.noise.scale)
    shooting = dataclasses.replace(made.shooting, noise=noise)
    nominal = shooting.fit([((), ())], made.nominal.starts)[0]
    return dataclasses.replace(made, shooting=shooting, nominal=nominal)


def test_a_stop_that_only_some_segments_reach_is_sought_further_in(struck) -> None:
    """What does not reach it says nothing of it to first order."""
    stop = next(e for e in struck.effects if e.strikes and e.variant == "upper")
    deep = struck.shooting.fit([((stop,), (np.array([200.0, DAMPING, 0.64]),))], struck.nominal.starts)[0]
    assert deep.chi2 > 100.0 * struck.shooting.dof
    found = struck_elsewhere(struck.shooting, deep)
    assert found.chi2 < 0.1 * struck.shooting.dof
    np.testing.assert_allclose(found.values[0], [STIFFNESS, DAMPING, AT], rtol=0.03)
    assert struck_elsewhere(struck.shooting, found) is found  # nothing stands out
    assert struck_elsewhere(struck.shooting, struck.nominal) is struck.nominal


def test_of_new_sets_with_a_stop_the_smallest_one_is_tried_with_it_elsewhere(struck, monkeypatch) -> None:
    """Where another place is what is wrong, further effects stood for that."""
    stop, wet = (next(e for e in struck.effects if e.name == name) for name in ("joint_stop", "viscous_friction"))
    values = np.array([200.0, DAMPING, 0.64])
    pair = struck.shooting.fit([((stop, wet), (values, np.array([0.1])))], struck.nominal.starts, rounds=0)[0]
    alone = struck.shooting.fit([((stop,), (values,))], struck.nominal.starts, rounds=0)[0]
    most = struck.nominal.chi2
    pair, alone, best = (
        dataclasses.replace(fit, chi2=share * most) for fit, share in ((pair, 0.5), (alone, 0.8), (alone, 0.1))
    )
    chosen = Selection(struck.nominal, [struck.nominal, pair, alone], Score(struck.shooting.samples, 60, 1.0))
    assert chosen.best is pair
    tried: list = []
    monkeypatch.setattr(module, "chained", lambda _, fit: fit)
    monkeypatch.setattr(module, "struck_elsewhere", lambda _, fit: tried.append(fit) or best)
    behind_impacts(chosen, struck.shooting, [frozenset(fit.effects) for fit in (pair, alone)])
    assert tried == [alone]
    assert chosen.best is best
    behind_impacts(chosen, struck.shooting, [], np.inf)  # none is new
    behind_impacts(chosen, struck.shooting, [frozenset(alone.effects)], struck.shooting.work)
    assert tried == [alone]
