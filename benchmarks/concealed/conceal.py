"""How a machine is driven and recorded: what hides its effects."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.signal import butter, filtfilt, freqz, lfilter

from benchmarks.concealed.dynamics import mass_and_bias, room
from benchmarks.concealed.excite import KINDS, excitation
from benchmarks.concealed.plant import A, J, Plant
from benchmarks.concealed.systems import System
from benchmarks.concealed.truth import Motion, Signal, simulate


@dataclasses.dataclass(frozen=True)
class Recorder:
    """How a case is recorded.

    Args:
        rate: Hz.
        noise: (n,), standard deviation of the encoders, rad or m.
        step: (n,), of their quantisation, 0 for none.
        color: correlation of the noise from row to row, as a filtered encoder leaves it.
        jitter: of the sampling instants, in periods; the recorded clock is right.
        missed: share of control cycles that are missed: no row, and the control is held on.
        start: first reading of the clock, s.
        velocities: whether a tachometer is recorded too.
        closed: whether a loop follows goals; `stiff`: its bandwidth, rad/s.
        corner: of a Butterworth filter of second order that passes positions forth and back afterwards, Hz; 0 for none.
    """

    rate: int
    noise: np.ndarray
    step: np.ndarray
    color: float
    jitter: float
    missed: float
    start: float
    velocities: bool
    closed: bool
    stiff: float
    corner: float = 0.0

    @property
    def deviation(self) -> np.ndarray:
        """Noise and quantisation together, as they are recorded, (n,)."""
        passed = 1.0
        if self.corner:
            passed = float(np.mean(np.abs(freqz(*butter(2, self.corner, fs=self.rate))[1]) ** 4))
        return np.sqrt(passed * self.noise**2 + self.step**2 / 12)

    @property
    def concealments(self) -> list[str]:
        """What hides the effect, in words for the breakdown."""
        said = {
            "closed loop": self.closed,
            "quantised": bool(self.step.any()),
            "filtered noise": self.color > 0 or self.corner > 0,
            "jittered": self.jitter > 0,
            "dropped rows": self.missed > 0,
            "clock offset": self.start != 0,
            "with velocities": self.velocities,
        }
        return [name for name, true in said.items() if true]


def draw_recorder(plant: Plant, closed: bool, rng: np.random.Generator) -> Recorder:
    """Draw noise of 0.2-5 mrad (0.06-1.5 mm) and the rest; each further concealment in about one case of five."""
    rate = int(rng.choice([50, 100, 100, 200, 250, 500]))
    noise = np.exp(rng.uniform(np.log(2e-4), np.log(5e-3))) * np.where(plant.tree.slide, 0.3, 1.0)
    if np.isfinite(plant.joint[:, J.WALL]).any():  # the engine's step at an impact is worth 0.1 mm
        noise = np.maximum(noise, 4e-4)
    coarse = rng.random() < 0.2
    return Recorder(
        rate=rate,
        noise=noise * (0.3 if coarse else 1.0),
        step=noise * rng.uniform(1.5, 3.5) if coarse else np.zeros_like(noise),
        color=rng.uniform(0.4, 0.85) if rng.random() < 0.2 else 0.0,
        jitter=rng.uniform(0.03, 0.15) if rng.random() < 0.2 else 0.0,
        missed=rng.uniform(0.005, 0.03) if rng.random() < 0.2 else 0.0,
        start=round(float(rng.uniform(10, 5e4)), 3) if rng.random() < 0.2 else 0.0,
        velocities=bool(rng.random() < 0.3),
        closed=closed,
        stiff=rng.uniform(0.5, 1.0) * min(20.0, 0.2 * rate),
    )


def filtered_after(recorder: Recorder, plant: Plant, rng: np.random.Generator) -> Recorder:
    """The recorder, with positions that somebody filtered forth and back afterwards, in one of five that allow it.

    Those with an even clock of 100 Hz or more and white noise; not where something is struck, which filters smear.
    """
    spoilt = recorder.step.any() or recorder.color or recorder.jitter or recorder.missed
    if spoilt or recorder.rate < 100 or np.isfinite(plant.joint[:, J.WALL]).any() or rng.random() > 0.2:
        return recorder
    return dataclasses.replace(
        recorder, corner=float(np.clip(rng.uniform(15, 40), 0.06 * recorder.rate, 0.3 * recorder.rate))
    )


@dataclasses.dataclass(frozen=True)
class Run:
    """One run before it happens: signal and initial state, and the noise of its record."""

    signal: Signal
    q0: np.ndarray
    v0: np.ndarray


def home_inertia(plant: Plant) -> np.ndarray:
    """Diagonal of the mass matrix with rotors where all joints are at zero, (n,)."""
    n = len(plant.joint)
    M, bias, zero = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    mass_and_bias(plant.tree, zero, zero, room(n), M, bias)
    return np.diag(M) + plant.joint[:, J.ROTOR]


def draw_runs(system: System, plant: Plant, recorder: Recorder, count: int, rng: np.random.Generator) -> list[Run]:
    """Draw runs of 4-8 s, each with its own kind of excitation; about one in six swings freely."""
    kinds = [*KINDS] if recorder.closed or system.servo else [*KINDS, "swing"]
    order = [*rng.permutation(kinds), *rng.choice(kinds, 20)]
    longest = 5.5 if len(plant.joint) > 3 else 8.0
    drawn = [_draw_run(system, plant, recorder, (kind, rng.uniform(4, longest)), rng) for kind in order[:count]]
    return [_tamed(plant, run) for run in drawn]


def _tamed(plant: Plant, run: Run) -> Run:
    """The run with less control and speed, where the nominal would leave 2.5 rad or 0.8 m, or pass 12 rad/s."""
    for _ in range(8):
        motion = simulate(plant, run.signal, run.q0, run.v0, 1e-3)
        reach, speed = np.where(plant.tree.slide, 0.8, 2.5), np.where(plant.tree.slide, 4.0, 12.0)
        if (np.abs(motion.q).max(0) < reach).all() and (np.abs(motion.v).max(0) < speed).all():
            break
        signal = run.signal
        signal = signal._replace(feed=0.7 * signal.feed, goal=0.7 * signal.goal, goal_speed=0.7 * signal.goal_speed)
        run = Run(signal, run.q0, 0.7 * run.v0)
    return run


def _draw_run(
    system: System, plant: Plant, recorder: Recorder, plan: tuple[str, float], rng: np.random.Generator
) -> Run:
    kind, seconds = plan
    time = _clock(recorder, seconds, rng)
    rows, n, m = len(time), len(plant.joint), len(plant.actuator)
    driven = plant.actuator[:, A.JOINT].astype(int)
    slide = plant.tree.slide
    push = np.where(slide, system.acceleration[1], system.acceleration[0]) * home_inertia(plant)
    unit = (push[driven] / (plant.actuator[:, A.GEAR] * plant.actuator[:, A.GAIN])) * rng.uniform(0.4, 1.1)
    if system.servo:
        unit = np.full(m, rng.uniform(0.2, 0.5))
    feed, goal, speed = np.zeros((rows, m)), np.zeros((rows, n)), np.zeros((rows, n))
    kp, kd, limit = np.zeros(m), np.zeros(m), np.full(m, np.inf)
    for i in range(m if kind != "swing" else 0):
        signal, rate = excitation(kind, time, rng)
        if recorder.closed:
            size = rng.uniform(0.3, 0.8) * (0.3 if slide[driven[i]] else 1.0)
            goal[:, driven[i]], speed[:, driven[i]] = size * signal, size * rate
        else:
            feed[:, i] = unit[i] * signal
    if recorder.closed:
        spring = home_inertia(plant)[driven] * recorder.stiff**2
        kp = spring / (plant.actuator[:, A.GEAR] * plant.actuator[:, A.GAIN])
        kd, limit = 1.6 * kp / recorder.stiff, 4 * unit + 0.5 * kp
    q0, v0 = rng.normal(size=n) * 0.02 * system.spread, np.zeros(n)
    if kind == "swing":
        q0 = rng.uniform(-1.2, 1.2, n) * np.where(slide, 0.1, 1.0) * system.spread
        v0 = rng.uniform(-1.5, 1.5, n) * np.where(slide, 0.5, 2.0)
    noise = _noise(recorder, rows, rng)
    return Run(Signal(time, feed, goal, speed, kp, kd, limit, noise), q0, v0)


def _clock(recorder: Recorder, seconds: float, rng: np.random.Generator) -> np.ndarray:
    count = int(seconds * recorder.rate)
    time = np.arange(count) + np.clip(recorder.jitter * rng.normal(size=count), -0.4, 0.4)
    time[0] = 0.0
    keep = rng.random(count) >= recorder.missed
    keep[:2] = True
    return np.round(time[keep] / recorder.rate, 6)


def _noise(recorder: Recorder, rows: int, rng: np.random.Generator) -> np.ndarray:
    white = rng.normal(size=(rows + 50, len(recorder.noise)))
    colored = lfilter([np.sqrt(1 - recorder.color**2)], [1, -recorder.color], white, axis=0)[50:]
    return np.ascontiguousarray(colored * recorder.noise)


def table(
    run: Run, motion: Motion, recorder: Recorder, names: tuple[Sequence[str], Sequence[str]], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """The canonical columns of a run as it is recorded; names: of the joints and of the actuators."""
    reading = motion.y + run.signal.noise
    if recorder.corner:
        reading = filtfilt(*butter(2, recorder.corner, fs=recorder.rate), reading, axis=0)
    steps = np.where(recorder.step > 0, recorder.step, 1.0)
    reading = np.where(recorder.step > 0, np.round(reading / steps) * steps, reading)
    columns = {"time": run.signal.time + recorder.start}
    columns |= {f"qpos.{name}": reading[:, j] for j, name in enumerate(names[0])}
    if recorder.velocities:
        tacho = motion.v + 15 * recorder.deviation * rng.normal(size=motion.v.shape)
        columns |= {f"qvel.{name}": tacho[:, j] for j, name in enumerate(names[0])}
    return columns | {f"ctrl.{name}": motion.u[:, i] for i, name in enumerate(names[1])}
