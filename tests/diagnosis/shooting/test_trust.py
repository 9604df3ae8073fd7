from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.elimination import eliminate
from torch_activegp.diagnosis.shooting.trust import Trust


@pytest.fixture
def trust(bench):
    return Trust([bench.effect("coulomb_friction")])


def test_steps_get_shorter_until_they_are_too_short(trust) -> None:
    rng = np.random.default_rng(0)
    linear = eliminate(rng.normal(size=(2, 30, 2)), rng.normal(size=(2, 30, 1)), 5.0 + rng.normal(size=(2, 30)))
    at, whole = np.array([0.5]), np.linalg.lstsq(linear.normal.sum(0), linear.gradient.sum(0), rcond=None)[0]
    first = trust.step(linear, at)
    np.testing.assert_allclose(first, np.maximum(whole, -at), rtol=1e-5)  # its level has no sign
    sizes = []
    while not trust.shorten(hopeful=False):
        sizes.append(abs(trust.step(linear, at)[0]))
    assert 1 <= len(sizes) < 5
    assert (np.diff([abs(first[0]), *sizes]) < 0).all()
    trust.begin()
    np.testing.assert_allclose(trust.step(linear, at), first)
    assert sum(1 for _ in iter(lambda: trust.shorten(hopeful=True), True)) > len(sizes)


def test_parameters_stay_within_their_bounds(trust) -> None:
    np.testing.assert_array_equal(trust.inside(np.array([-1.0])), [0.0])


def test_what_steps_are_worth_is_untold_until_one_helped_a_little_or_was_refused(trust) -> None:
    assert trust.untold
    trust.lengthen(much=True)
    assert trust.untold
    trust.lengthen(much=False)
    assert not trust.untold
    trust.begin()
    assert trust.untold
    trust.shorten(hopeful=True)
    assert not trust.untold
