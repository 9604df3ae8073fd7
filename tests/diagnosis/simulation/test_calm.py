from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.simulation import calm
from torch_activegp.diagnosis.simulation.calm import CalmEngine
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine


@pytest.fixture
def limited(bench):
    """The pendulum with a limit that it reaches in some of its segments."""
    highest = np.rad2deg(np.quantile(bench.segments.position, 0.9))
    return bench.integrated("Euler", 0.01, f'limited="true" range="-900 {highest}"').model


@pytest.fixture
def engines(bench, limited):
    """One that takes 8 steps where the limit is near and 2 elsewhere, and one for either."""
    channels = bench.engine.channels
    return CalmEngine(limited, channels, 8, calm=2, nthread=1), *(Engine(limited, channels, n, 1) for n in (8, 2))


def test_few_steps_are_taken_where_nothing_touches(bench, engines) -> None:
    parted, often, seldom = engines
    segments, rng = bench.segments, np.random.default_rng(0)
    reached = segments.position.max(axis=(1, 2)) >= parted.model.jnt_range[0, 1]
    touched = parted.touched(segments)
    assert reached.any() and not touched.all()
    assert touched[reached].all()
    pushed = Candidate(force=rng.normal(size=(segments.size, segments.intervals, 1)))
    shoved = Candidate(shove=rng.normal(size=(segments.size, segments.intervals, 1)))
    candidates = [NOMINAL, pushed, shoved]
    starts = np.repeat(bench.nominal.starts[None], 3, axis=0)
    many, few, own = (e.predict(segments, starts, candidates) for e in (often, seldom, parted))
    np.testing.assert_array_equal(own[:, touched], many[:, touched])
    np.testing.assert_array_equal(own[:, ~touched], few[:, ~touched])
    assert np.abs(many - few)[:, ~touched].max() > 1e-6
    part = touched.mean()
    assert parted.work == pytest.approx(part * often.work + (1.0 - part) * seldom.work)


def test_what_wants_short_steps_itself_takes_them_everywhere(bench, engines) -> None:
    parted, often, _ = engines
    starts = bench.nominal.starts[None]
    for name, values in (("coulomb_friction", [0.1]), ("hysteresis", [0.5, 0.2]), ("viscous_friction", [0.1])):
        candidate = Candidate((bench.effect(name),), (np.array(values),))
        own, other = (e.predict(bench.segments, starts, [candidate]) for e in (parted, often))
        assert np.array_equal(own, other) == (name != "viscous_friction")


def test_all_or_none_of_the_segments_may_touch(bench, engines) -> None:
    parted, often, seldom = engines
    touched = parted.touched(bench.segments)
    for which, engine in ((touched, often), (~touched, seldom)):
        segments, starts = bench.segments.pick(which), bench.nominal.starts[which][None]
        own, other = (e.predict(segments, starts, [NOMINAL]) for e in (parted, engine))
        np.testing.assert_array_equal(own, other)


def test_poses_of_long_runs_are_looked_at_now_and_then(bench, engines, monkeypatch) -> None:
    parted = engines[0]
    every = parted.touched(bench.segments)
    monkeypatch.setattr(calm, "_MOST_ROWS", 50)
    parted._known.clear()
    some = parted.touched(bench.segments)
    assert some[every].all()
    assert not some.all()
