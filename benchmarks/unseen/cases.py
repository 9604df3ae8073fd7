"""Makes one case: draws effects, sizes them by how badly the nominal then fits, and has a lab tune the nominal."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.unseen.catalogue import Spec
from benchmarks.unseen.effects import Effect, truth
from benchmarks.unseen.excite import Plan, controller, plan
from benchmarks.unseen.machine import Machine
from benchmarks.unseen.machines import MACHINES
from benchmarks.unseen.regression import regress
from benchmarks.unseen.shooting import Segments, fit
from benchmarks.unseen.simulate import Path, simulate
from benchmarks.unseen.sizes import Scales, draw, scaled

Array = np.ndarray
CLEAR, WEAK = 3.0, (1.05, 1.6)


@dataclass
class Case:
    """What is written."""

    spec: Spec
    machine: Machine
    effects: list[Effect]
    values: dict[str, float]
    plan: Plan
    path: Path
    readings: Array
    chi2: float
    alone: dict[str, float] = field(default_factory=dict)
    chi2_untuned: float = 1.0
    retuned: dict[str, tuple[float, float]] = field(default_factory=dict)


class Bench:
    """A machine with its experiments fixed, on which effects are tried."""

    def __init__(self, machine: Machine, rng: np.random.Generator) -> None:
        self.machine, self.rng = machine, rng
        self.rough = any(j.frictionloss for j in machine.joints)
        self.plan = plan(machine, rng)
        self.pick = int(rng.integers(1 << 30))
        path, _ = self.record([])
        self.scales = Scales.of(machine.plant(), path)

    def record(self, effects: list[Effect]) -> tuple[Path, Array]:
        """All runs with these effects: what happened, and what the encoders show."""
        plant, p = truth(self.machine, effects), self.plan
        readings = np.empty((*p.time.shape, len(self.machine.joints)))
        stiff = any(e.name in ("backlash", "joint_stop") for e in effects)
        step = min(self.machine.step, 0.001) if stiff else self.machine.step
        act = controller(self.machine, p, readings)
        path = simulate(plant, p.time, (p.start, np.zeros_like(p.start)), act, step)
        if not (np.isfinite(path.q).all() and np.abs(path.q).max() < 1e4):
            raise ValueError(f"{self.machine.name} ran away with {effects}")
        return path, readings

    def segments(self, path: Path, data: Array, most: int) -> Segments:
        """Pieces of the runs, without the test run."""
        runs = Path(*(x[:-1] for x in (path.time, path.q, path.v, path.reading, path.control)))
        return Segments.of(self.machine, runs, data[:-1], most, np.random.default_rng(self.pick))

    def chi2(self, path: Path, values: dict[str, float] | None = None) -> float:
        """Expected chi2 per degree of freedom of the nominal, with free initial states."""
        return 1 + fit(self.machine, self.segments(path, path.reading, 10), values or self.machine.values()).chi2

    def most(self, kind: str) -> float:
        """The largest chi2 of a plain effect: where sensors are fine, errors of 2 % of the travel are still common.

        Where it sticks and slips they are 20 %: near breakaway a breath changes a whole segment.
        """
        part = 0.2 if self.rough else 0.02
        sigma = np.array([noise.std for noise in self.machine.noise])
        fine = float(np.median((part * self.scales.travel / sigma) ** 2))
        return max(900.0, 0.15 * fine) if kind == "retuned" and not self.rough else max(6000.0, fine)

    def sized(self, effect: Effect, low: float, high: float, aim: float) -> tuple[Effect, float]:
        """The effect made so strong that the nominal's chi2 is within the bounds."""
        chi2 = np.inf
        for _ in range(7):
            try:
                chi2 = self.chi2(self.record([effect])[0])
            except ValueError:  # too much for the controller
                effect = scaled(effect, 0.4)
                continue
            if low <= chi2 <= high:
                break
            effect = scaled(effect, float(np.clip(np.sqrt((aim - 1) / max(chi2 - 1, 1e-6)), 0.03, 6.0)))
        return effect, chi2


def _choose(machine: Machine, rng: np.random.Generator) -> tuple[str, ...]:
    """What this lab tunes: damping always, then inertias or gains, and the biases that the file has."""
    values = machine.values()
    other = ("armature",) if rng.random() < 0.5 else ("gain", "gear", "kp")
    return tuple(k for k in values if k.partition("_")[0] in ("damping", "bias", *other))


def _retune(case: Case, bench: Bench) -> Case:
    """A lab fits the nominal to the recordings; the effects must still show afterwards."""
    machine = case.machine
    tune = _choose(machine, bench.rng)
    for attempt in range(5):
        if bench.rough:
            found = regress(machine, case.readings[:-1], case.path.control[:-1], tune)
        else:
            pieces = bench.segments(case.path, case.readings, 12)
            found = fit(machine, pieces, machine.values(), tune, rounds=8).values
        values = {k: float(f"{v:.6g}") for k, v in found.items()}
        chi2 = bench.chi2(case.path, values)
        if chi2 >= 1.6 or attempt == 4:
            break
        case.effects = [scaled(e, 1.6) for e in case.effects]
        case.path, case.readings = bench.record(case.effects)
        case.chi2_untuned = bench.chi2(case.path)
    before = machine.values()
    case.values, case.chi2 = values, chi2
    case.retuned = {k: (before[k], values[k]) for k in tune}
    return case


def build(spec: Spec, seed: int, index: int) -> Case:
    """The case, from scratch; the same for the same seed and index."""
    machine = MACHINES[spec.machine]
    rng = np.random.default_rng([seed, 2, index])
    bench = Bench(machine, rng)
    effects: list[Effect] = []
    alone: dict[str, float] = {}
    for name, target in spec.effects:
        effect = draw(machine, name, target, bench.scales, rng)
        aim = rng.uniform(1.08, 1.5)
        if spec.kind == "weak":
            effect, chi2 = bench.sized(effect, max(WEAK[0], aim - 0.1), min(WEAK[1], aim + 0.1), aim)
        elif spec.kind == "outside":
            effect, chi2 = bench.sized(effect, 20.0, 1e4, 300.0)
        else:
            most = bench.most(spec.kind)
            aim = float(np.exp(rng.uniform(np.log(max(10.0, most / 300)), np.log(most / 3))))
            effect, chi2 = bench.sized(effect, 2 * CLEAR, most, aim)
        effects.append(effect)
        alone[f"{name}@{target}"] = round(chi2, 3)
    path, readings = bench.record(effects)
    case = Case(spec, machine, effects, machine.values(), bench.plan, path, readings, bench.chi2(path), alone)
    case.chi2_untuned = case.chi2
    return _retune(case, bench) if spec.kind == "retuned" else case


def problems(case: Case) -> list[str]:
    """What would make it a bad case."""
    found = []
    q = case.path.q
    for j, joint in enumerate(case.machine.joints):
        if q[..., j].min() < joint.limits[0] or q[..., j].max() > joint.limits[1]:
            found.append(f"{joint.name} past its limits")
        if np.ptp(q[..., j]) < 20 * case.machine.noise[j].std:
            found.append(f"{joint.name} hardly moves")
    clear = [c for c in case.alone.values() if c < CLEAR]
    if case.spec.kind == "weak" and not WEAK[0] <= case.chi2 <= WEAK[1]:
        found.append(f"weak, but chi2 {case.chi2:.2f}")
    if case.spec.kind in ("single", "two", "three", "outside") and clear:
        found.append(f"not clear: {case.alone}")
    if case.spec.kind == "retuned" and case.chi2 < 1.3:
        found.append(f"absorbed: chi2 {case.chi2:.2f}")
    if case.spec.kind == "control" and case.chi2 > 1.01:
        found.append(f"control, but chi2 {case.chi2:.3f}")
    return found
