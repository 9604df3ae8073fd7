from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from tests.diagnosis.ram import ram
from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.chaining import _at_rest, borrowed, chained, passed
from torch_activegp.diagnosis.shooting.likelihood import ROUNDS, Shooting
from torch_activegp.diagnosis.simulation.engine import Engine

NOISE = 2e-4


@pytest.fixture(scope="module")
def striking() -> Shooting:
    """A ram that strikes a wall twice a second; its speed jumps there, and that of a smoothed recording does not."""
    machine = ram(step=0.001, soft=0.004, noise=NOISE, rows=401)
    engine = Engine(machine.model, machine.channels, 10, 1)
    return Shooting(engine, cut(machine.fit, 0.25, 0.1), NoiseModel.white(np.array([NOISE])))


def test_segments_begin_where_the_ones_before_lead(striking) -> None:
    fit = striking.fit([((), ())], striking.engine.starts(striking.segments))[0]
    samples = striking.segments.counts.sum(axis=1)
    stuck = fit.per_segment > 30 * samples
    assert 2 <= stuck.sum() < striking.segments.size // 3
    again = chained(striking, fit)
    assert again.chi2 < 0.05 * fit.chi2
    assert again.chi2 == pytest.approx(again.per_segment.sum())
    assert (again.per_segment[stuck] < 0.1 * fit.per_segment[stuck]).all()
    well = fit.per_segment < 2 * samples
    np.testing.assert_array_equal(again.starts[well], fit.starts[well])


def test_what_stands_out_nowhere_is_left_alone(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    assert chained(bench.shooting, fit) is fit


def test_a_set_of_effects_is_fitted_again_behind_better_states(bench, monkeypatch) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    last = bench.segments.size - 1
    begun = fit.starts.copy()
    begun[last] += np.array([0.5, 8.0])
    held = bench.shooting.fit([(fit.effects, fit.values)], begun, rounds=0, hold=True)[0]
    off = (fit.values[0] * 1.02,)
    stuck = dataclasses.replace(fit, values=off, starts=begun, chi2=held.chi2, per_segment=held.per_segment)
    again = chained(bench.shooting, stuck)
    assert again.chi2 == pytest.approx(fit.chi2, rel=1e-3)
    np.testing.assert_allclose(again.values[0], fit.values[0], rtol=1e-3)
    asked, real = list[int](), Shooting.fit

    def fitted(self, sets, starts, rounds=ROUNDS, **how):
        asked.append(rounds)
        return real(self, sets, starts, rounds, **how)

    monkeypatch.setattr(Shooting, "fit", fitted)
    chained(bench.shooting, stuck, rounds=7)
    assert asked[-1] == 7


@pytest.mark.parametrize(("louder", "freed"), [(1.0, True), (1.6, False)])
def test_near_the_noise_alone_a_segment_that_stands_out_a_little_begins_anew(bench, louder: float, freed: bool) -> None:
    """Twice the usual chi2 is much where that is noise; where all leave more, it may be what is missing."""
    fit = bench.fit("viscous_friction", 0.05)
    last, begun = bench.segments.size - 1, fit.starts.copy()
    level = fit.per_segment / bench.segments.samples
    for size in np.linspace(0.0, 0.1, 1001)[1:]:
        begun[last, 0] = fit.starts[last, 0] + size
        held = bench.shooting.fit([(fit.effects, fit.values)], begun, rounds=0, hold=True)[0]
        if held.per_segment[last] > 2.0 * np.median(level) * bench.segments.samples[last]:
            break
    per_segment = louder * held.per_segment / np.median(level)
    stuck = dataclasses.replace(fit, starts=begun, chi2=per_segment.sum(), per_segment=per_segment, design=held.design)
    assert (chained(bench.shooting, stuck) is not stuck) is freed


STUCK = """
<mujoco><option timestep="0.001" integrator="RK4"/><default><joint solreffriction="0.004 1"/></default><worldbody>
<body name="sled"><joint name="x" type="slide" axis="1 0 0" damping="2" frictionloss="3"/>
<geom type="sphere" size="0.05" mass="2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor name="coil" joint="x"/></actuator></mujoco>"""


def test_a_joint_that_friction_holds_may_begin_at_rest() -> None:
    """A segment that begins creeping lets go at another instant, and no derivative leads back to standing still."""
    model = mujoco.MjModel.from_xml_string(STUCK)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    time = np.arange(501) / 100
    control = 5.0 * np.cos(2 * np.pi * 0.7 * time) * np.minimum(time, 1.0)
    position = []
    for force in control:
        position.append(data.qpos[0])
        data.ctrl[:] = force
        mujoco.mj_step(model, data, 10)
    columns = {"time": time, "qpos.x": np.array(position) + 2e-5 * rng.normal(size=501), "ctrl.coil": control}
    recording = Recording.from_columns("sticks", columns)
    machine = make_machine(model, [recording], [recording])
    engine = Engine(model, machine.channels, 10, 1)
    shooting = Shooting(engine, cut(machine.fit, 1.0, 0.1), NoiseModel.white(np.array([2e-5])))
    begun = engine.starts(shooting.segments)
    begun[0] = 0.0, -1.0  # there is no segment before that one
    fit = shooting.fit([((), ())], begun, rounds=6)[0]
    assert fit.per_segment[0] > 30 * shooting.segments.samples[0]
    again = chained(shooting, fit)
    assert again.chi2 / shooting.dof < 1.1


@pytest.fixture(scope="module")
def two() -> Shooting:
    """Two joints that move."""
    xml = STUCK.replace(
        "</body></worldbody>",
        '<body><joint name="y" axis="0 1 0"/><geom size=".1" pos="0 0 .2"/></body></body></worldbody>',
    )
    time = np.arange(101) / 100
    columns = {"time": time, "qpos.x": np.sin(5.0 * time), "qpos.y": np.cos(4.0 * time), "ctrl.coil": 0.0 * time}
    recording = Recording.from_columns("moves", columns)
    machine = make_machine(mujoco.MjModel.from_xml_string(xml), [recording], [recording])
    engine = Engine(machine.model, machine.channels, 10, 1)
    return Shooting(engine, cut(machine.fit, 0.25, 0.1), NoiseModel.white(np.array([1e-3, 1e-3])))


def test_each_joint_of_several_may_be_the_one_at_rest(two) -> None:
    smooth = two.engine.starts(two.segments)
    assert smooth.all(axis=0)[2:].all()
    moving = [(start[:, 2:] != 0.0).all(axis=0).tolist() for start in _at_rest(two)]
    assert moving == [[False, False], [False, True], [True, False]]
    assert all((start[:, :2] == smooth[:, :2]).all() for start in _at_rest(two))


def test_to_be_at_rest_is_tried_once(two, monkeypatch) -> None:
    """A second round would end as the first one: only where the segments before lead may be another place then."""
    tried: list[bytes] = []
    fit_segments, at_rest = Shooting.fit, [start for start in _at_rest(two)]

    def listen(self, sets, starts, *args, **kwargs):
        tried.extend(start.tobytes() for way in starts for start in way if kwargs.get("hold"))
        return fit_segments(self, sets, starts, *args, **kwargs)

    fit = two.fit([((), ())], two.engine.starts(two.segments))[0]
    monkeypatch.setattr(Shooting, "fit", listen)
    monkeypatch.setattr("torch_activegp.diagnosis.shooting.chaining._STANDS_OUT", 0.0)
    monkeypatch.setattr("torch_activegp.diagnosis.shooting.chaining._BETTER", -np.inf)  # all rounds are made
    chained(two, fit)
    assert len(tried) > 4 * two.segments.size
    assert all(tried.count(row.tobytes()) == 1 for start in at_rest for row in start)
    tried.clear()
    chained(two, fit, rest=False)
    assert tried
    assert not any(tried.count(row.tobytes()) for start in at_rest for row in start)


def test_segments_begin_where_another_set_begins_them_if_that_is_better(bench) -> None:
    """Which it fits no better than the set itself, and with none of its parameters."""
    fit, nominal = bench.fit("viscous_friction", 0.05), bench.nominal
    begun = fit.starts.copy()
    begun[2] += np.array([0.5, 8.0])
    (stuck,) = bench.shooting.fit([(fit.effects, fit.values)], begun, rounds=0, hold=True)
    known = dataclasses.replace(nominal, per_segment=fit.per_segment)
    again = borrowed(bench.shooting, stuck.without_derivatives, known)
    assert again.chi2 == pytest.approx(fit.chi2, rel=1e-3)
    np.testing.assert_allclose(again.values[0], fit.values[0], rtol=1e-3)
    assert borrowed(bench.shooting, fit, nominal) is fit  # nowhere better
    (lost,) = bench.shooting.fit([(fit.effects, fit.values)], begun, hold=True)
    assert borrowed(bench.shooting, lost, dataclasses.replace(known, starts=lost.starts)) is lost


def test_a_fit_passes_through_where_longer_segments_begin(bench) -> None:
    """Near where they begin; a smoothed recording is taken where the fit was not, and where its simulation failed."""
    fit, longer = bench.fit("viscous_friction", 0.05), cut(bench.machine.fit, 0.9, 0.1)
    smooth = bench.engine.starts(longer)
    found = passed(bench.shooting, fit, longer)
    along = bench.engine.trajectories(bench.segments, fit.starts, fit.candidate)
    for s, (run, first) in enumerate(zip(longer.run, longer.first, strict=True)):
        there = np.flatnonzero((bench.segments.run == run) & (bench.segments.first <= first))[-1]
        np.testing.assert_array_equal(found[s], along[there, first - bench.segments.first[there]])
    assert np.abs(found - smooth).max() > 1e-3
    part = bench.shooting.pick(bench.segments.run == 1)
    elsewhere = passed(part, fit.pick(bench.segments.run == 1), longer)
    np.testing.assert_array_equal(elsewhere[longer.run == 0], smooth[longer.run == 0])
    np.testing.assert_array_equal(elsewhere[longer.run == 1], found[longer.run == 1])
    lost = dataclasses.replace(fit, starts=np.full_like(fit.starts, np.nan))
    np.testing.assert_array_equal(passed(bench.shooting, lost, longer), smooth)
