"""Simulations with effects through a simulator that only returns its next state, against closed forms and scipy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.blackbox import BlackBox, accelerations
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.physics.effect import Effect
from torch_activegp.simulators import ActionSpace, OdeSimulator, StateSpace, semi_implicit_euler

RATE = 100
_NOISE = NoiseModel.white(np.array([1e-3]))


def mass(dt: float = 1 / RATE) -> OdeSimulator:
    """A unit mass on a line, pushed by its control."""
    states = StateSpace(["x", "speed"], -np.inf, np.inf)
    return OdeSimulator(lambda x, u: torch.cat((x[..., 1:], u), -1), states, ActionSpace(["push"], -9.0, 9.0), dt)


class Bench:
    """An engine over one run, with a control that is a function of time."""

    def __init__(self, control, seconds=1.0, dt=1 / RATE, simulator=None, time=None) -> None:
        self.time = np.arange(round(seconds * RATE) + 1) / RATE if time is None else time
        columns = {"time": self.time, "qpos.x": np.sin(3 * self.time), "ctrl.push": control(self.time)}
        self.box = BlackBox.of(simulator or mass(dt))
        run = Recording.from_columns("run", columns)
        self.machine = make_machine(self.box.model, [run], [run], self.box if simulator is None else None)
        self.engine = BlackBoxEngine(self.box, self.machine.channels, round(1 / RATE / self.box.simulator.dt))
        self.segments = cut(self.machine.fit, 1e9, 0.0)
        self.effects = accelerations(effects_for(self.box.model, self.machine.channels, self.machine.fit))

    def go(self, start, *pairs, force=None) -> np.ndarray:
        """States ``(K + 1, 2)`` from a start, with effects by name and variant or class, and their values."""
        chosen = [(self.find(name), np.array(values, dtype=float)) for name, values in pairs]
        candidate = Candidate(tuple(e for e, _ in chosen), tuple(v for _, v in chosen), force)
        return self.engine.trajectories(self.segments, np.array([start], dtype=float), candidate)[0]

    def find(self, name: str) -> Effect:
        name, _, variant = name.partition("/")
        return next(e for e in self.effects if e.name == name and e.variant == variant)


def still(time):
    return np.zeros_like(time)


def test_without_effects_it_is_the_simulator(black) -> None:
    simulator, recordings = black.simulator(), [black.record("none", 0)]
    box = BlackBox.of(simulator)
    machine = make_machine(box.model, recordings, recordings, box)
    engine, segments = BlackBoxEngine(box, machine.channels, 1), cut(machine.fit, 1e9, 0.0)
    start = np.array([[3.0, 4.0]])
    states = engine.trajectories(segments, start, NOMINAL)[0]
    wanted = simulator.rollout(torch.tensor([3.0, 4.0]).double(), torch.from_numpy(machine.fit[0].control.copy()))
    wrapped = simulator.state_space.wrap(torch.from_numpy(states[1:]))
    np.testing.assert_allclose(wrapped, wanted, atol=1e-9)
    assert np.abs(np.diff(states[:, 0])).max() < 1.0
    assert np.abs(states[:, 0]).max() > np.pi


@pytest.mark.parametrize(
    ("pairs", "law"),
    [
        ([("viscous_friction", [0.8])], lambda q, v: -0.8 * v),
        ([("quadratic_drag", [0.8])], lambda q, v: -0.8 * v * abs(v)),
        ([("linear_spring", [20.0])], lambda q, v: -20.0 * q),
        ([("viscous_friction", [-0.8]), ("cubic_spring", [9.0])], lambda q, v: 0.8 * v - 9.0 * q**3),
        ([("asymmetric_friction", [1.5, 0.2]), ("linear_spring", [20.0])], None),
    ],
)
def test_laws_are_exact_to_second_order(pairs, law) -> None:
    if law is None:

        def law(q, v):
            return -(1.5 if v > 0 else 0.2) * v - 20.0 * q

    exact = solve_ivp(lambda _, s: [s[1], 2.0 + law(*s)], (0.0, 1.0), [0.5, 1.0], rtol=1e-10, atol=1e-12)
    errors = []
    for dt in (1 / RATE, 0.5 / RATE):
        states = Bench(lambda t: 2.0 + 0 * t, dt=dt).go([0.5, 1.0], *pairs)
        errors.append(np.abs(states[-1] - exact.y[:, -1]).max())
    assert errors[0] < 2e-3
    assert errors[1] < 0.35 * errors[0]


def test_what_sticks_stays_where_it_is_and_breaks_loose() -> None:
    bench = Bench(lambda t: np.where(t < 0.495, 0.9, 1.5))
    states = bench.go([0.2, 0.0], ("coulomb_friction", [1.0]))
    np.testing.assert_array_equal(states[:51], np.tile([0.2, 0.0], (51, 1)))
    np.testing.assert_allclose(states[-1], [0.2 + 0.5 * 0.5 * 0.5**2, 0.25], atol=1e-9)


def test_dry_friction_stops_a_slide_and_never_turns_it() -> None:
    states = Bench(still).go([0.0, 0.5], ("coulomb_friction", [1.0]))
    np.testing.assert_allclose(states[:40, 1], 0.5 - np.arange(40) / RATE, atol=1e-9)
    assert states[-1, 0] == pytest.approx(0.5**2 / 2, abs=1e-4)
    assert states[:, 1].min() == 0.0
    assert np.ptp(states[60:, 0]) == 0.0


def test_dry_friction_of_two_directions_and_of_two_speeds() -> None:
    bench = Bench(still)
    for speed, wanted in ((1.0, 1.0 - 0.8 * 0.2), (-1.0, -1.0 + 0.3 * 0.2)):
        states = bench.go([0.0, speed], ("asymmetric_friction/coulomb", [0.8, 0.3]))
        assert states[20, 1] == pytest.approx(wanted, abs=1e-9)
    fast, slow = (bench.go([0.0, v], ("stribeck_friction", [0.2, 0.6, 0.1]))[1, 1] - v for v in (2.0, 0.02))
    assert fast * RATE == pytest.approx(-0.2, abs=1e-6)
    assert slow * RATE == pytest.approx(-0.78, abs=0.05)


def test_a_slider_follows_and_slips() -> None:
    states = Bench(still).go([np.sin(0.0), 1.0], ("hysteresis", [2.0, 0.05]))
    gone = states[:, 0] > 0.06
    slowing = np.diff(states[:, 1])[gone[:-1]] * RATE
    np.testing.assert_allclose(slowing, -2.0 * 0.05, rtol=1e-3)


def test_controls_are_delayed_and_pushed_by_a_force() -> None:
    bench = Bench(lambda t: np.where(t < 0.005, 0.0, 1.0))
    late = bench.go([0.0, 0.0], ("actuator_delay", [0.1]))
    assert late[-1, 1] == pytest.approx(0.99 - 0.1, abs=1e-6)
    force = np.full((1, bench.segments.intervals, 1), 0.5)
    pushed = Bench(still).go([0.0, 0.0], force=force)
    np.testing.assert_allclose(pushed[-1], [0.25, 0.5], atol=1e-9)


def test_sensors_read_what_their_effects_make_of_it() -> None:
    bench = Bench(still)
    effect = next(e for e in bench.effects if e.name == "sensor_bias")
    starts = np.array([[[0.0, 1.0]]])
    read = bench.engine.predict(bench.segments, starts, [Candidate((effect,), (np.array([0.3]),))])
    np.testing.assert_allclose(read[0, 0, :, 0], 0.3 + bench.time, atol=1e-9)


def test_time_steps_are_counted() -> None:
    """A search ends by them."""
    bench = Bench(still)
    bench.engine.predict(bench.segments, np.zeros((3, 1, 2)), [NOMINAL] * 3)
    assert bench.engine.work == 3 * bench.segments.intervals == 3 * bench.engine.steps_in(bench.segments)


def test_what_is_handed_out_takes_controls_when_they_come() -> None:
    bench = Bench(np.sin)
    late = BlackBoxEngine(bench.box, bench.machine.channels, 1, late=True)
    engines = (bench.engine, late, late.without_leapfrog())
    own, later, handed = (e.trajectories(bench.segments, np.zeros((1, 2)), NOMINAL) for e in engines)
    assert not np.array_equal(own, later)
    np.testing.assert_array_equal(handed, own)


def test_rows_off_the_clock_are_read_where_they_are() -> None:
    time = np.arange(101) / RATE
    time[1:-1] += np.random.default_rng(0).uniform(-0.002, 0.002, 99)
    states = Bench(lambda t: 1.0 + 0 * t, time=time).go([0.0, 0.0])
    np.testing.assert_allclose(states, np.stack([time**2 / 2, time], axis=1), atol=1e-9)


def test_a_sample_that_diverges_leaves_the_others_alone() -> None:
    def rates(x, u):
        return torch.cat((x[..., 1:], torch.where(x[..., :1] > 5.0, torch.nan, u)), -1)

    states = StateSpace(["x", "speed"], -np.inf, np.inf)
    bench = Bench(still, simulator=OdeSimulator(rates, states, ActionSpace(["push"], -9.0, 9.0), 1 / RATE))
    starts = np.array([[[0.0, 10.0]], [[0.0, 1.0]]])
    read = bench.engine.predict(bench.segments, starts, [NOMINAL, NOMINAL])
    assert np.isnan(read[0]).all()
    np.testing.assert_allclose(read[1, 0, :, 0], bench.time, atol=1e-9)


def test_controls_off_the_clock_act_when_they_did() -> None:
    """A control that switches between two rows, each off the clock by up to a fifth of an interval."""
    time = np.arange(101) / RATE
    time[1:-1] += np.random.default_rng(0).uniform(-0.002, 0.002, 99)
    states = Bench(lambda t: np.where(t < time[40], 0.0, 1.0), time=time).go([0.0, 0.0])
    since = np.maximum(time - time[40], 0.0)
    np.testing.assert_allclose(states[:, 0], since**2 / 2, atol=2e-5)
    np.testing.assert_allclose(states[45:, 1], since[45:], atol=1e-9)


def test_semi_implicit_euler_is_exact_to_second_order_once_its_controls_are_late(black) -> None:
    recordings, errors = [black.record("none", 0, 1.0)], {}
    for dt in (0.02, 0.01):
        simulator = black.simulator(dt)
        simulator.integrator = semi_implicit_euler
        machine = make_machine(BlackBox.of(simulator).model, recordings, recordings)
        truth = BlackBoxEngine(BlackBox.of(black.simulator(0.005)), machine.channels, 4)
        segments = cut(machine.fit, 0.3, 0.0)
        start = truth.trajectories(segments, truth.starts(segments), NOMINAL)
        for late in (False, True):
            engine = BlackBoxEngine(BlackBox.of(simulator), machine.channels, round(0.02 / dt), late=late)
            shooting = Shooting(engine, dataclasses.replace(segments, position=start[..., :1]), _NOISE)
            errors[dt, late] = np.sqrt(shooting.fit([((), ())], start[:, 0])[0].chi2)
    assert errors[0.02, True] < 0.1 * errors[0.02, False]
    assert errors[0.01, True] < 0.35 * errors[0.02, True]
