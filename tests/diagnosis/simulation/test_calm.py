from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.simulation import calm
from torch_activegp.diagnosis.simulation.calm import CalmEngine, SmoothEngine
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


@pytest.fixture
def smoothed(bench):
    """One that takes 10 steps or 2, and one that takes 10."""
    model, channels = bench.engine.model, bench.engine.channels
    return SmoothEngine(model, channels, 10, 2, np.array([1e-5]), 1), Engine(model, channels, 10, 1)


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


@pytest.mark.parametrize(
    ("name", "target", "values", "smooth"),
    [
        ("viscous_friction", "joint:hip", [0.1], True),
        ("actuator_gain", "actuator:drive", [0.2], True),
        ("coulomb_friction", "joint:hip", [0.1], False),
        ("hysteresis", "joint:hip", [0.5, 0.2], False),
        ("joint_stop", "joint:hip", [50.0, 1.0, 0.5], False),
        ("actuator_lag", "actuator:drive", [0.02], False),
        ("actuator_delay", "actuator:drive", [0.004], False),
    ],
)
def test_a_machine_takes_long_steps_but_for_what_happens_within_one(
    bench, smoothed, name: str, target: str, values: list[float], smooth: bool
) -> None:
    engine, full = smoothed
    candidate = Candidate((bench.effect(name, target),), (np.array(values),))
    where = bench.segments, bench.nominal.starts[None]
    bare, wanted = (one.predict(*where, [NOMINAL]) for one in (engine, full))
    assert 0.0 < np.abs(bare - wanted).max() < 1e-5
    before = engine.work
    own, other = (one.predict(*where, [candidate]) for one in (engine, full))
    assert np.array_equal(own, other) is not smooth
    assert np.abs(own - other).max() < 1e-5
    assert (engine.work - before < 0.5 * full.steps_in(bench.segments)) is smooth


def test_a_stiff_candidate_takes_short_steps_and_its_companions_do_not(bench, smoothed) -> None:
    """A spring that makes the machine as quick as 100 rad/s; and dry friction beside both changes neither."""
    engine, full = smoothed
    spring, dry = bench.effect("linear_spring"), bench.effect("coulomb_friction")
    stiff, soft = (Candidate((spring,), (np.resize(np.array([k, 0.0]), len(spring.parameters)),)) for k in (3e3, 0.1))
    stuck = Candidate((dry,), (np.array([0.1]),))
    starts = np.repeat(bench.nominal.starts[None], 3, axis=0)
    own, wanted = (one.predict(bench.segments, starts, [stiff, soft, stuck]) for one in (engine, full))
    np.testing.assert_array_equal(own[[0, 2]], wanted[[0, 2]])
    assert 0.0 < np.abs(own[1] - wanted[1]).max() < 1e-5
    alone = engine.predict(bench.segments, starts[:1], [soft])
    np.testing.assert_array_equal(alone[0], own[1])


def test_where_a_long_step_fails_short_ones_are_taken(bench, smoothed, monkeypatch) -> None:
    engine, full = smoothed
    candidates, starts = (
        [NOMINAL, Candidate((bench.effect("viscous_friction"),), (np.array([0.1]),))],
        bench.nominal.starts,
    )
    where = bench.segments, np.repeat(starts[None], 2, axis=0), candidates
    calm, sought = engine._calm, engine._calm._simulate

    def fail(*args):
        states = sought(*args)
        states[0, -1] = np.nan
        return states

    monkeypatch.setattr(calm, "_simulate", fail)
    own, wanted = engine.predict(*where), full.predict(*where)
    np.testing.assert_array_equal(own[0], wanted[0])
    assert np.isfinite(own).all() and not np.array_equal(own[1], wanted[1])


def test_where_something_touches_short_steps_are_taken(bench, limited) -> None:
    channels = bench.engine.channels
    engine, full = SmoothEngine(limited, channels, 8, 2, np.array([np.inf]), 1), Engine(limited, channels, 8, 1)
    touched, where = engine.touched(bench.segments), (bench.segments, bench.nominal.starts[None], [NOMINAL])
    own, wanted = (one.predict(*where)[0] for one in (engine, full))
    assert touched.any() and not touched.all()
    np.testing.assert_array_equal(own[touched], wanted[touched])
    assert not np.array_equal(own[~touched], wanted[~touched])
