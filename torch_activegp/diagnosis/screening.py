"""Score test: what would each effect gain, to first order, on top of a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.elimination import eliminate, invert
from torch_activegp.diagnosis.engine import Candidate
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.linearize import Linearization, linearize
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.physics.actuation import ActuatorEffect
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.play import Hysteresis
from torch_activegp.physics.sensing import SensorEffect

_SAME = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class Atom:
    """An effect at one of its seeds, and what it would gain.

    Args:
        effect: the effect.
        values: its parameters with the amplitudes that fit best, ``(P,)``.
        gain: decrease of chi2 to first order.
        columns: where its columns stand in the screen's normal matrix.
        seed: the parameters that these columns belong to.
    """

    effect: Effect
    values: Array
    gain: float
    columns: slice
    seed: Array


@dataclasses.dataclass(frozen=True)
class Screen:
    """The result of a score test.

    Args:
        atoms: all of them.
        normal: normal matrix of all columns after states and fitted parameters are projected out, ``(A, A)``.
        gradient: ``(A,)``.
    """

    atoms: tuple[Atom, ...]
    normal: Array
    gradient: Array

    def best(self) -> list[Atom]:
        """The best seed of every effect (name, target and variant), best first."""
        chosen: dict[Effect, Atom] = {}
        for atom in self.atoms:
            if atom.effect not in chosen or atom.gain > chosen[atom.effect].gain:
                chosen[atom.effect] = atom
        return sorted(chosen.values(), key=lambda atom: -atom.gain)

    def joint_gain(self, atoms: Sequence[Atom]) -> float:
        """What several atoms gain together."""
        return self.together(atoms)[0]

    def losses(self, atoms: Sequence[Atom]) -> list[float]:
        """What the others lose without each of several atoms (Wald statistics)."""
        index = np.concatenate([np.arange(a.columns.start, a.columns.stop) for a in atoms])
        inverse = invert(self.normal[np.ix_(index, index)])
        amplitude = inverse @ self.gradient[index]
        ends = np.cumsum([a.columns.stop - a.columns.start for a in atoms])
        parts = [slice(end - (a.columns.stop - a.columns.start), end) for a, end in zip(atoms, ends, strict=True)]
        return [_wald(amplitude[part], inverse[part, part]) for part in parts]

    def together(self, atoms: Sequence[Atom]) -> tuple[float, list[Array]]:
        """What several atoms gain together, and the parameters with which they do."""
        index = np.concatenate([np.arange(a.columns.start, a.columns.stop) for a in atoms])
        gain, amplitude = _gain(self.normal[np.ix_(index, index)], self.gradient[index])
        parts = np.split(amplitude, np.cumsum([a.columns.stop - a.columns.start for a in atoms])[:-1])
        return gain, [_with_amplitude(atom.effect, atom.seed, part) for atom, part in zip(atoms, parts, strict=True)]


def screen(shooting: Shooting, fit: Fit, effects: Sequence[Effect]) -> Screen:
    """Tests every effect at every seed on top of a fit.

    Force laws and what happens to controls are read off the linearisation around the fit's trajectories; only effects
    that change masses or gravity are simulated.

    Args:
        shooting: the likelihood.
        fit: what is there already.
        effects: what could come.
    """
    linear = linearize(shooting, fit)
    plan, columns = _columns(shooting, fit, effects, linear)
    fitted = _parameter_columns(shooting, fit)
    start, held, tested = (shooting.whiten_columns(block) for block in (linear.respond_to_start(), fitted, columns))
    normal, gradient = _project(start, held, tested, shooting.residual_of(fit))
    atoms, at = [], 0
    for effect, seed, width in plan:
        where = slice(at, at + width)
        atoms.append(_atom(effect, seed, where, *_gain(normal[where, where], gradient[where])))
        at += width
    return Screen(tuple(atoms), normal, gradient)


def _atom(effect: Effect, seed: Array, where: slice, gain: float, amplitude: Array) -> Atom:
    values = _with_amplitude(effect, seed, amplitude)
    absent = not np.any(values[: effect.linear]) if effect.linear else amplitude[0] <= 0.0
    return Atom(effect, values, 0.0 if absent else gain, where, seed)


def _with_amplitude(effect: Effect, seed: Array, amplitude: Array) -> Array:
    values = seed.copy()
    if effect.linear:
        values[: effect.linear] = amplitude * _units(effect, seed)
    return np.clip(values, [p.low for p in effect.parameters], [p.high for p in effect.parameters])


def _units(effect: Effect, seed: Array) -> Array:
    scales = np.array([p.scale for p in effect.parameters[: effect.linear]])
    return np.where(seed[: effect.linear] != 0.0, seed[: effect.linear], scales)


def _unit_values(effect: Effect, seed: Array) -> list[Array]:
    """The seed with one amplitude after the other, the rest of them zero; the seed itself where none is linear."""
    if not effect.linear:
        return [seed]
    out = []
    for i, unit in enumerate(_units(effect, seed)):
        values = seed.copy()
        values[: effect.linear] = 0.0
        values[i] = unit
        out.append(values)
    return out


def _columns(
    shooting: Shooting, fit: Fit, effects: Sequence[Effect], linear: Linearization
) -> tuple[list[tuple[Effect, Array, int]], Array]:
    """Changes of the recorded positions by every amplitude of every seed, ``(S, K + 1, C, A)``."""
    plan = [(e, seed, max(e.linear, 1)) for e in effects for seed in e.seeds]
    wanted = [(e, values) for e, seed, _ in plan for values in _unit_values(e, seed)]
    shape = (*linear.states.shape[:2], len(linear.positions), len(wanted))
    out = np.zeros(shape)
    forces: dict[int, list[int]] = {}
    simulated: list[int] = []
    controlled: list[int] = []
    channel = {int(dof): c for c, dof in enumerate(shooting.engine.channels.dof)}
    for i, (effect, values) in enumerate(wanted):
        if isinstance(effect, JointEffect):
            forces.setdefault(channel[effect.dof], []).append(i)
        elif isinstance(effect, ActuatorEffect):
            controlled.append(i)
        elif isinstance(effect, SensorEffect):
            out[..., i] = _sensor_column(effect, values, linear)
        else:
            simulated.append(i)
    for c, members in forces.items():
        laws = np.stack([_law(*wanted[i], linear, c, shooting) for i in members], axis=-1)
        out[..., members] = linear.respond_to_force(c, laws)
    if controlled:
        out[..., controlled] = _control_columns([wanted[i] for i in controlled], linear, shooting)  # type: ignore[misc]
    if simulated:
        base = fit.candidate
        more = [Candidate((*base.effects, wanted[i][0]), (*base.values, wanted[i][1])) for i in simulated]
        starts = np.repeat(fit.starts[None], 1 + len(more), axis=0)
        predicted, _ = shooting.differences.predict(shooting.segments, starts, [base, *more])
        out[..., simulated] = np.moveaxis(predicted[1:] - predicted[0], 0, -1)
    return plan, out


def _law(effect: Effect, values: Array, linear: Linearization, channel: int, shooting: Shooting) -> Array:
    """The force of a law in the middle of every interval, ``(S, K)``."""
    position = linear.states[..., linear.positions[channel]]
    velocity = linear.states[..., linear.velocities[channel]]
    if isinstance(effect, Hysteresis):
        runs = shooting.segments.runs
        length = max(len(run) for run in runs)
        padded = np.stack([np.pad(run.smooth[:, channel], (0, length - len(run)), mode="edge") for run in runs])
        whole = effect.path(padded, values)
        index = np.minimum(shooting.segments.first[:, None] + np.arange(position.shape[1]), length - 1)
        along = whole[shooting.segments.run[:, None], index]
        return np.asarray(0.5 * (along[:, 1:] + along[:, :-1]))
    if effect.name == "armature_error":
        return np.asarray(-values[0] * np.diff(velocity, axis=1) / shooting.segments.dt)
    assert isinstance(effect, JointEffect)
    middle = 0.5 * (position[:, 1:] + position[:, :-1])
    return effect.force(middle, 0.5 * (velocity[:, 1:] + velocity[:, :-1]), values)


def _sensor_column(effect: SensorEffect, values: Array, linear: Linearization) -> Array:
    """A sensor changes its own channel, ``(S, K + 1, C)``."""
    out = np.zeros((*linear.states.shape[:2], len(linear.positions)))
    position = linear.states[..., linear.positions[effect.channel]]
    velocity = linear.states[..., linear.velocities[effect.channel]]
    changed = {"sensor_bias": values[0], "sensor_gain": values[0] * position, "sensor_delay": -values[0] * velocity}
    out[..., effect.channel] = changed[effect.name]
    return out


def _control_columns(
    wanted: Sequence[tuple[ActuatorEffect, Array]], linear: Linearization, shooting: Shooting
) -> Array:
    """Controls go through the same filters as in a simulation, and what they differ by through the linearisation."""
    segments, substeps = shooting.segments, 4
    runs = segments.runs
    length = max(len(run) - 1 for run in runs)
    plain = np.stack([np.pad(run.control, ((0, length - len(run) + 1), (0, 0)), mode="edge") for run in runs])
    dt = np.stack([np.pad(run.dt, (0, length - len(run) + 1), mode="edge") for run in runs])
    fine, steps = np.repeat(plain, substeps, axis=1), np.repeat(dt / substeps, substeps, axis=1)
    index = np.minimum(segments.first[:, None] + np.arange(segments.intervals), length - 1)
    inputs = []
    for effect, values in wanted:
        changed = effect.control(fine[None].copy(), steps, values[None])
        assert changed is not None
        mean = (changed[0] - fine)[..., effect.index].reshape(len(runs), length, substeps).mean(-1)
        difference = mean[segments.run[:, None], index]
        inputs.append(linear.control[..., effect.index] * difference[..., None])
    return linear.respond(np.stack(inputs, axis=-1))


def _parameter_columns(shooting: Shooting, fit: Fit) -> Array:
    """Changes of the recorded positions by the parameters that are already fitted, ``(S, K + 1, C, P)``."""
    moves = []
    for k, effect in enumerate(fit.effects):
        for i, parameter in enumerate(effect.parameters):
            step = 0.05 * max(abs(fit.values[k][i]), parameter.scale)
            step = -step if fit.values[k][i] + step > parameter.high else step
            moved = [v.copy() for v in fit.values]
            moved[k][i] += step
            moves.append(Candidate(fit.effects, tuple(moved)))
    starts = np.repeat(fit.starts[None], 1 + len(moves), axis=0)
    predicted, _ = shooting.differences.predict(shooting.segments, starts, [fit.candidate, *moves])
    return np.moveaxis(predicted[1:] - predicted[0], 0, -1)


def _project(states: Array, fitted: Array, columns: Array, residual: Array) -> tuple[Array, Array]:
    """Normal equations of the columns after the free states and the fitted parameters are projected out."""
    both = np.concatenate([fitted, columns], axis=-1)
    linear = eliminate(states, both, residual)
    normal, gradient = linear.normal.sum(0), linear.gradient.sum(0)
    p = fitted.shape[-1]
    if p:
        inverse = np.linalg.pinv(normal[:p, :p], rcond=1e-10)
        gradient = gradient[p:] - normal[p:, :p] @ inverse @ gradient[:p]
        normal = normal[p:, p:] - normal[p:, :p] @ inverse @ normal[:p, p:]
    return normal, gradient


def _wald(amplitude: Array, covariance: Array) -> float:
    """What is lost without some amplitudes."""
    if amplitude.size == 1 and covariance[0, 0] > 0.0:
        return float(amplitude[0] ** 2 / covariance[0, 0])
    return float(amplitude @ np.linalg.pinv(covariance) @ amplitude)


def _gain(normal: Array, gradient: Array) -> tuple[float, Array]:
    """Decrease of chi2 by some columns and their amplitudes; directions that nothing can see give none."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    matrix = normal / np.outer(scale, scale)
    value, vector = np.linalg.eigh(matrix)
    seen = value > _SAME
    projected = vector.T @ (gradient / scale)
    weights = np.where(seen, projected / np.where(seen, value, 1.0), 0.0)
    return float(projected @ weights), (vector @ weights) / scale
