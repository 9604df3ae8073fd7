"""A pendulum whose truth this file integrates itself, recorded with what its MuJoCo model leaves out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from torch_activegp.data import Recording
from torch_activegp.diagnosis import Diagnosis, diagnose
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine
from torch_activegp.diagnosis.inputs.runs import Channels, Run
from torch_activegp.diagnosis.inputs.segments import Segments, cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.physics import Effect
from torch_activegp.simulators import ActionSpace, OdeSimulator, StateSpace

XML = """
<mujoco model="pendulum"><option timestep="0.005" integrator="RK4"/><worldbody>
<body name="rod"><joint name="hip" axis="0 1 0"/>
<inertial pos="0 0 -0.5" mass="1" diaginertia="0.08 0.08 0.001"/></body></worldbody>
<actuator><motor name="drive" joint="hip"/></actuator></mujoco>"""
INERTIA = 0.08 + 0.5**2
NOISE = 1e-3
RATE = 100
SUBSTEPS = 4
VISCOUS = 0.06
_LAWS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "none": lambda q, v: np.zeros_like(q),
    "viscous": lambda q, v: -VISCOUS * v,
    "bump": lambda q, v: 0.8 * np.exp(-(((q - 0.4) / 0.08) ** 2)),
}


def swing(kind: str, seed: int, seconds: float = 2.0) -> dict[str, np.ndarray]:
    """Columns of a run: J a = -m g l sin q + u + law(q, v), by Runge-Kutta, with white noise on the position."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE) + 1) / RATE
    frequency, phase = rng.uniform(0.3, 1.5, 3), rng.uniform(0, 2 * np.pi, 3)
    control = (0.9 * np.sin(2 * np.pi * frequency * time[:, None] + phase)).sum(axis=1)
    h = 1 / RATE / SUBSTEPS

    def slope(x: np.ndarray, u: float) -> np.ndarray:
        torque = -9.81 * 0.5 * np.sin(x[0]) + u + _LAWS[kind](x[:1], x[1:])[0]
        return np.array([x[1], torque / INERTIA])

    x, angles = np.array([rng.normal(0.0, 0.5), 0.0]), []
    for u in control:
        angles.append(x[0])
        for _ in range(SUBSTEPS):
            a = slope(x, u)
            b = slope(x + h / 2 * a, u)
            c = slope(x + h / 2 * b, u)
            x = x + h / 6 * (a + 2 * b + 2 * c + slope(x + h * c, u))
    return {"time": time, "qpos.hip": np.array(angles) + NOISE * rng.normal(size=len(time)), "ctrl.drive": control}


@dataclasses.dataclass(frozen=True)
class Bench:
    """What the diagnosis works with for a pendulum of one kind."""

    kind: str
    machine: Machine
    engine: Engine
    segments: Segments
    shooting: Shooting
    effects: tuple[Effect, ...]
    nominal: Fit

    xml = XML
    noise = NOISE
    viscous = VISCOUS

    def integrated(self, integrator: str, step: float, joint: str = "") -> Machine:
        """The machine by another integrator and time step, s, with more attributes of its joint."""
        text = self.xml.replace("RK4", integrator).replace("0.005", str(step))
        text = text.replace('name="hip"', f'name="hip" {joint}', 1)
        return dataclasses.replace(self.machine, model=mujoco.MjModel.from_xml_string(text))

    def effect(self, name: str, target: str = "joint:hip") -> Effect:
        return next(effect for effect in self.effects if effect.key == (name, target))

    def fit(self, name: str, *values: float) -> Fit:
        return self.shooting.fit([((self.effect(name),), (np.array(values),))], self.nominal.starts)[0]

    def predict(self, candidate: Candidate, starts: np.ndarray | None = None) -> np.ndarray:
        """Positions ``(S, K + 1, C)`` from the nominal's initial states."""
        begin = self.nominal.starts if starts is None else starts
        return self.engine.predict(self.segments, begin[None], [candidate])[0]


def make_bench(kind: str) -> Bench:
    recordings = [Recording.from_columns(f"run{i}", swing(kind, i)) for i in range(2)]
    return assemble(kind, XML, recordings, Recording.from_columns("kept", swing(kind, 9)))


def assemble(kind: str, xml: str, recordings: list[Recording], kept: Recording) -> Bench:
    model = mujoco.MjModel.from_xml_string(xml)
    machine = make_machine(model, recordings, [kept])
    engine = Engine(model, machine.channels, 2, 1)
    segments = cut(machine.fit, 0.5, 0.1)
    shooting = Shooting(engine, segments, NoiseModel.white(np.array([NOISE])))
    nominal = shooting.fit([((), ())], engine.starts(segments))[0]
    effects = tuple(effects_for(model, machine.channels, machine.fit))
    return Bench(kind, machine, engine, segments, shooting, effects, nominal)


@dataclasses.dataclass(frozen=True)
class Servo:
    """The pendulum held by a position servo, whose force ends at a limit that the model does not have."""

    xml: str = XML.replace('<motor name="drive" joint="hip"/>', '<position name="drive" joint="hip" kp="12" kv="1"/>')

    def record(self, limit: float, seed: int) -> Recording:
        """A run with steps of the command every 0.4 s, by the semi-implicit Euler scheme in steps of 0.2 ms."""
        rng, h = np.random.default_rng(seed), 2e-4
        time = np.arange(round(3.0 * RATE) + 1) / RATE
        control = rng.uniform(-0.7, 0.7, 8)[(time / 0.4).astype(int)]
        q, v, angles = 0.0, 0.0, []
        for u in control:
            angles.append(q)
            for _ in range(round(1 / RATE / h)):
                force = np.clip(12 * (u - q) - v, -limit, limit) - 9.81 * 0.5 * np.sin(q)
                v += h * force / INERTIA
                q += h * v
        noisy = np.array(angles) + NOISE * rng.normal(size=len(time))
        return Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": noisy, "ctrl.drive": control})

    def bench(self, limit: float) -> Bench:
        """What the diagnosis works with."""
        return assemble(f"servo {limit}", self.xml, [self.record(limit, i) for i in range(2)], self.record(limit, 9))


@pytest.fixture(scope="session")
def servo() -> Servo:
    """Records a servo."""
    return Servo()


@pytest.fixture(scope="session")
def bench() -> Bench:
    """A pendulum with viscous friction that its model leaves out."""
    return make_bench("viscous")


@pytest.fixture(scope="session")
def clean() -> Bench:
    """A pendulum that its model describes."""
    return make_bench("none")


@pytest.fixture(scope="session")
def diagnosed() -> Callable[[str], Diagnosis]:
    """The diagnosis of the pendulum of each kind, made once."""
    made: dict[str, Diagnosis] = {}

    def get(kind: str) -> Diagnosis:
        if kind not in made:
            recordings = [Recording.from_columns(f"run{i}", swing(kind, i)) for i in range(3)]
            made[kind] = diagnose(XML, recordings, [Recording.from_columns("kept", swing(kind, 9))], nthread=1)
        return made[kind]

    return get


@pytest.fixture(scope="session")
def record() -> Callable[..., Recording]:
    """Makes a recording of a kind and a seed, with columns replaced or, where they are None, left out."""

    def make(
        kind: str = "none", seed: int = 0, name: str = "run", seconds: float = 2.0, **changes: object
    ) -> Recording:
        columns = {**swing(kind, seed, seconds), **{k.replace("__", "."): v for k, v in changes.items()}}
        return Recording.from_columns(name, {k: v for k, v in columns.items() if v is not None})

    return make


@pytest.fixture
def model() -> mujoco.MjModel:
    """The nominal model, and the one that MuJoCo loaded last."""
    return mujoco.MjModel.from_xml_string(XML)


@pytest.fixture(scope="session")
def channels(record: Callable[..., Recording]) -> Channels:
    return Channels.of(mujoco.MjModel.from_xml_string(XML), [record()])


@pytest.fixture(scope="session")
def make_plain_run() -> Callable[..., Run]:
    """Makes a run from positions alone, at 100 Hz, every row recorded unless said."""

    def make(position: np.ndarray, recorded: np.ndarray | None = None, noise: float = NOISE, label: str = "r") -> Run:
        rows = len(position)
        column = np.asarray(position, dtype=float).reshape(rows, -1)
        return Run(
            label,
            np.arange(rows) / RATE,
            column,
            np.ones(rows, dtype=bool) if recorded is None else recorded,
            np.gradient(column, 1 / RATE, axis=0),
            column,
            np.zeros((rows - 1, 1)),
            np.zeros((rows - 1, 1)),
            np.full(column.shape[1], noise),
        )

    return make


class Black:
    """A pendulum in torch, and recordings of a truth that scipy integrates: theta'' = -9 sin theta + 2 u + law."""

    rate = 50
    noise = 1e-3
    damping = 0.25
    stiffness = 1.5

    def law(self, kind: str, q: float, v: float) -> float:
        laws = {
            "none": 0.0,
            "viscous spring": -self.damping * v - self.stiffness * q,
            "unlisted": 1.5 * np.sin(3 * q) * np.cos(2 * v),
        }
        return float(laws[kind])

    def simulator(self, dt: float = 1 / rate) -> OdeSimulator:
        def rates(x: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
            return torch.cat((x[..., 1:], 2.0 * u - 9.0 * torch.sin(x[..., :1])), -1)

        states = StateSpace(["theta", "speed"], [-np.pi, -20.0], [np.pi, 20.0], angles=[0])
        return OdeSimulator(rates, states, ActionSpace(["motor"], -5.0, 5.0), dt)

    def record(self, kind: str, seed: int, seconds: float = 4.0) -> Recording:
        rng = np.random.default_rng(seed)
        time = np.arange(round(seconds * self.rate) + 1) / self.rate
        frequency, phase = rng.uniform(0.2, 1.2, 3), rng.uniform(0, 2 * np.pi, 3)
        control = np.sin(2 * np.pi * frequency * time[:, None] + phase).sum(axis=1)
        x, angles = np.array([rng.normal(0.0, 0.5), 0.0]), []
        for u in control:
            angles.append(x[0])

            def slope(_: float, s: np.ndarray, u: float = u) -> list[float]:
                return [s[1], -9.0 * np.sin(s[0]) + 2.0 * u + self.law(kind, s[0], s[1])]

            x = solve_ivp(slope, (0.0, 1 / self.rate), x, rtol=1e-8, atol=1e-10).y[:, -1]
        theta = np.array(angles) + self.noise * rng.normal(size=len(time))
        wrapped = (theta + np.pi) % (2 * np.pi) - np.pi
        return Recording.from_columns(f"run{seed}", {"time": time, "qpos.theta": wrapped, "ctrl.motor": control})


@pytest.fixture(scope="session")
def black() -> Black:
    """A simulator that only returns its next state, with recordings."""
    return Black()


class Double:
    """A double pendulum whose shoulder a rig moves on a known path, and whose elbow scipy integrates."""

    rate = 100
    noise = 1e-3
    viscous = 0.05
    reach, arm, mass, inertia = 1.0, 0.4, 0.7, 0.04
    xml = """
<mujoco model="double"><option timestep="{step}" integrator="{integrator}"/><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" {shoulder}/>
<inertial pos="0 0 -0.5" mass="1" diaginertia="0.08 0.08 0.001"/>
<body name="lower" pos="0 0 -1"><joint name="elbow" axis="0 1 0"/>
<inertial pos="0 0 -0.4" mass="0.7" diaginertia="0.04 0.04 0.001"/></body></body></worldbody>
<actuator><motor name="rig" joint="shoulder" gear="50"/><motor name="drive" joint="elbow"/></actuator></mujoco>"""

    def model(self, step: float = 0.005, integrator: str = "RK4", shoulder: str = "") -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(self.xml.format(step=step, integrator=integrator, shoulder=shoulder))

    def path(self, time: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration of the shoulder."""
        rng = np.random.default_rng(seed + 100)
        omega, phase = 2 * np.pi * rng.uniform(0.2, 0.7, 3), rng.uniform(0, 2 * np.pi, 3)
        angle = omega * np.asarray(time)[..., None] + phase
        waves = np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle)
        q, v, a = (0.4 * wave.sum(axis=-1) for wave in waves)
        return q, v, a

    def columns(
        self, seed: int, viscous: float = 0.0, seconds: float = 4.0, noise: float = 0.0, drive: float = 0.5
    ) -> dict[str, np.ndarray]:
        """A run: J (q'' + p'') = u - c v - m d (l p'' cos q + l p'^2 sin q + g sin(p + q)), p the shoulder."""
        rng = np.random.default_rng(seed)
        time = np.arange(round(seconds * self.rate) + 1) / self.rate
        omega, phase = 2 * np.pi * rng.uniform(0.3, 1.5, 3), rng.uniform(0, 2 * np.pi, 3)
        control = drive * np.sin(omega * time[:, None] + phase).sum(axis=1)
        moment, total = self.mass * self.arm, self.inertia + self.mass * self.arm**2

        def slope(t: float, s: np.ndarray, u: float) -> list[float]:
            p, w, a = self.path(np.array(t), seed)
            base = self.reach * (a * np.cos(s[0]) + w**2 * np.sin(s[0])) + 9.81 * np.sin(p + s[0])
            return [s[1], (u - viscous * s[1] - moment * base) / total - float(a)]

        x, angles, speeds = np.array([rng.normal(0.0, 0.4), 0.0]), [], []
        for t, u in zip(time, control, strict=True):
            angles.append(x[0])
            speeds.append(x[1])
            x = solve_ivp(slope, (t, t + 1 / self.rate), x, args=(u,), rtol=1e-9, atol=1e-11).y[:, -1]
        shoulder = self.path(time, seed)[0]
        return {
            "time": time,
            "qpos.shoulder": shoulder + 0.1 * noise * rng.normal(size=len(time)),
            "qpos.elbow": np.array(angles) + noise * rng.normal(size=len(time)),
            "ctrl.drive": control,
            "speed": np.array(speeds),
        }

    def record(
        self, seed: int, viscous: float = 0.0, prescribed: tuple[str, ...] = ("shoulder",), **options: float
    ) -> Recording:
        columns = self.columns(seed, viscous, **options)
        del columns["speed"]
        return Recording.from_columns(f"run{seed}", columns, prescribed=prescribed)


@pytest.fixture(scope="session")
def double() -> Double:
    """A machine of which one joint is moved from outside."""
    return Double()
