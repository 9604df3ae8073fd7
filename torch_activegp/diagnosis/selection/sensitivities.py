"""What effects and fitted parameters do to the recorded positions, around a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.inertial_forces import change, inertial_forces, with_effects
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import Linearization
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.readings import readings
from torch_activegp.physics.actuator import ActuatorEffect
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.play import Hysteresis
from torch_activegp.physics.sensing import SensorDelay, SensorEffect
from torch_activegp.physics.servo import ServoSaturation

_MOST_BYTES = 30_000_000
"""Of controls that are changed side by side."""


def units_of(effect: Effect, seed: Array) -> Array:
    """The amplitudes of a seed, or their scales where it has none."""
    scales = np.array([p.scale for p in effect.parameters[: effect.linear]])
    return np.where(seed[: effect.linear] != 0.0, seed[: effect.linear], scales)


def unit_values(effect: Effect, seed: Array) -> list[Array]:
    """The seed with one amplitude after the other, the rest of them zero; the seed itself where none is linear."""
    if not effect.linear:
        return [seed]
    out = []
    for i, unit in enumerate(units_of(effect, seed)):
        values = seed.copy()
        values[: effect.linear] = 0.0
        values[i] = unit
        out.append(values)
    return out


def effect_columns(
    shooting: Shooting,
    fit: Fit,
    wanted: Sequence[tuple[Effect, Array]],
    linear: Linearization,
    memory: Mapping[int, Array],
) -> Array:
    """Changes of the recorded positions by effects with unit amplitudes, ``(S, K + 1, C, A)``."""
    shape = (*linear.states.shape[:2], len(linear.positions), len(wanted))
    out = np.zeros(shape)
    forces: dict[int, list[int]] = {}
    simulated: list[int] = []
    controlled: list[int] = []
    channel = channels_of(shooting)
    served = any(isinstance(effect, ServoSaturation) for effect, _ in wanted)
    control = shooting.engine.controls(shooting.segments, fit.candidate) if served else None
    for i, (effect, values) in enumerate(wanted):
        if isinstance(effect, JointEffect):
            forces.setdefault(channel[effect.dof], []).append(i)
        elif isinstance(effect, ServoSaturation):
            forces.setdefault(channel[effect.servo.dof], []).append(i)
        elif isinstance(effect, SensorEffect):
            out[..., i] = _sensor_column(effect, values, linear, shooting.segments.dt)
        else:
            (controlled if isinstance(effect, ActuatorEffect) else simulated).append(i)
    for c, members in forces.items():
        laws = np.stack([_law(*wanted[i], linear, c, shooting, control, memory.get(i)) for i in members], axis=-1)
        out[..., members] = linear.respond_to_force(c, laws)
    if controlled:
        chosen = [(wanted[i][0], memory[i]) for i in controlled]
        out[..., controlled] = _control_columns(chosen, linear, shooting)
    loads, columns = _inertial_columns(shooting, fit, {i: wanted[i] for i in simulated}, linear)
    out[..., loads] = columns
    simulated = [i for i in simulated if i not in loads]
    if simulated:
        base = fit.candidate
        more = [Candidate((*base.effects, wanted[i][0]), (*base.values, wanted[i][1])) for i in simulated]
        starts = np.repeat(fit.starts[None], 1 + len(more), axis=0)
        predicted = shooting.differences.predict(shooting.segments, starts, [base, *more])
        out[..., simulated] = np.moveaxis(predicted[1:] - predicted[0], 0, -1)
    return out


def _all_seen(shooting: Shooting) -> bool:
    """Whether forces between rows tell all that a change of inertia does: every joint is seen, in every time step."""
    channels, model, stride = shooting.engine.channels, shooting.engine.model, shooting.differences.stride
    seen = {*channels.dof.tolist(), *(channels.prescribed.dof.tolist() if channels.prescribed is not None else [])}
    return bool(model.nq == model.nv == len(seen) and stride == 1)


def _inertial_columns(
    shooting: Shooting, fit: Fit, wanted: Mapping[int, tuple[Effect, Array]], linear: Linearization
) -> tuple[list[int], Array]:
    """What changes of inertia or gravity on top of a fit do, as forces in the middle of every interval.

    Returns:
        The numbers of those effects that are no more than that, where it is seen, and their columns,
        ``(S, K + 1, C, A)``.
    """
    model = with_effects(shooting.engine.model, fit.effects, fit.values) if wanted and _all_seen(shooting) else None
    found = {i: change(model, *pair) for i, pair in wanted.items()} if model is not None else {}
    changes = {i: one for i, one in found.items() if one is not None}
    if model is None or not changes:
        return [], np.zeros((*linear.states.shape[:2], len(linear.positions), 0))
    states = np.nan_to_num(linear.states)
    middle = 0.5 * (states[:, 1:] + states[:, :-1])
    faster = np.diff(states[..., model.nq :], axis=1) / shooting.segments.dt[..., None]
    position, velocity, acceleration = (
        some.reshape(-1, model.nv) for some in (middle[..., : model.nq], middle[..., model.nq :], faster)
    )
    forces = inertial_forces(model, position, velocity, acceleration, list(changes.values()))
    felt = forces[:, shooting.engine.channels.dof].reshape(*middle.shape[:2], -1, len(changes))
    return list(changes), linear.respond(linear.force @ felt)


def _law(
    effect: Effect,
    values: Array,
    linear: Linearization,
    channel: int,
    shooting: Shooting,
    control: Array | None,
    whole: Array | None,
) -> Array:
    """The force of a law in the middle of every interval, ``(S, K)``; one with a memory has it over whole runs.

    That of a servo wants what reaches it in each interval, ``(S, K, nu)``.
    """
    position = linear.states[..., linear.positions[channel]]
    velocity = linear.states[..., linear.velocities[channel]]
    if whole is not None:
        index = np.minimum(shooting.segments.first[:, None] + np.arange(position.shape[1]), whole.shape[1] - 1)
        along = whole[shooting.segments.run[:, None], index]
        return np.asarray(0.5 * (along[:, 1:] + along[:, :-1]))
    if effect.name == "armature_error":
        return np.asarray(-values[0] * np.diff(velocity, axis=1) / shooting.segments.dt)
    assert isinstance(effect, JointEffect | ServoSaturation)
    middle, speed = (0.5 * (some[:, 1:] + some[:, :-1]) for some in (position, velocity))
    if isinstance(effect, ServoSaturation):
        assert control is not None
        return effect.added(middle, speed, control[..., effect.servo.index], values)
    return effect.force(middle, speed, values)


def _sensor_column(effect: SensorEffect, values: Array, linear: Linearization, dt: Array) -> Array:
    """What a sensor changes in its own channel, ``(S, K + 1, C)``; a delay to first order, which is fast."""
    position, velocity = linear.states[..., linear.positions], linear.states[..., linear.velocities]
    if not isinstance(effect, SensorDelay):
        return readings([Candidate((effect,), (values,))], position[None], velocity[None], dt)[0] - position
    out = np.zeros_like(position)
    out[..., effect.channel] = -values[0] * velocity[..., effect.channel]
    return out


def remembered(wanted: Sequence[tuple[Effect, Array]], shooting: Shooting) -> dict[int, Array]:
    """What effects with a memory do over whole runs, however many segments are looked at then.

    Returns:
        By its number, for each effect on an actuator, the change of its control, which goes through the same filters as
        in a simulation, mean over each interval, ``(R, T)``; for each hysteresis its force at each row, ``(R, T + 1)``.
    """
    runs, substeps = shooting.segments.runs, 4
    length = max(len(run) - 1 for run in runs)
    plain = np.stack([np.pad(run.control, ((0, length - len(run) + 1), (0, 0)), mode="edge") for run in runs])
    smooth = np.stack([np.pad(run.smooth, ((0, length - len(run) + 1), (0, 0)), mode="edge") for run in runs])
    dt = np.stack([np.pad(run.dt, (0, length - len(run) + 1), mode="edge") for run in runs])
    fine, steps = np.repeat(plain, substeps, axis=1), np.repeat(dt / substeps, substeps, axis=1)
    channel = channels_of(shooting)
    filters = shooting.engine.filters
    behind = fine[None].copy()
    for own in filters:
        own.apply(behind, steps)
    out: dict[int, Array] = {}
    seeds: dict[ActuatorEffect, list[int]] = {}
    for i, (effect, values) in enumerate(wanted):
        if isinstance(effect, ActuatorEffect):
            seeds.setdefault(effect, []).append(i)
        elif isinstance(effect, Hysteresis):
            out[i] = effect.path(smooth[..., channel[effect.dof]], values)
    most = max(_MOST_BYTES // max(fine.nbytes, 1), 1)
    parts = [(effect, every[i : i + most]) for effect, every in seeds.items() for i in range(0, len(every), most)]
    for effect, members in parts:
        values = np.stack([wanted[i][1] for i in members])
        changed = effect.control(np.repeat(fine[None], len(members), axis=0), steps, values)
        assert changed is not None
        for own in (own for own in filters if own.lag.index == effect.index):
            own.apply(changed, steps)
        more = changed[..., effect.index] - behind[..., effect.index]
        out |= dict(zip(members, more.reshape(len(members), len(runs), length, substeps).mean(-1), strict=True))
    return out


def channels_of(shooting: Shooting) -> dict[int, int]:
    """The number of each recorded joint by its degree of freedom."""
    return {int(dof): c for c, dof in enumerate(shooting.engine.channels.dof)}


def _control_columns(changed: Sequence[tuple[Effect, Array]], linear: Linearization, shooting: Shooting) -> Array:
    """What changes of controls over whole runs do, through the linearisation, ``(S, K + 1, C, A)``."""
    segments = shooting.segments
    inputs = []
    for effect, mean in changed:
        assert isinstance(effect, ActuatorEffect)
        index = np.minimum(segments.first[:, None] + np.arange(segments.intervals), mean.shape[1] - 1)
        inputs.append(linear.control[..., effect.index] * mean[segments.run[:, None], index][..., None])
    return linear.respond(np.stack(inputs, axis=-1))


def parameter_columns(shooting: Shooting, fit: Fit) -> Array:
    """Changes of the recorded positions by the parameters that are already fitted, ``(S, K + 1, C, P)``."""
    moves = []
    for k, effect in enumerate(fit.effects):
        for i, parameter in enumerate(effect.parameters):
            moved = [v.copy() for v in fit.values]
            moved[k][i] += parameter.step(float(fit.values[k][i]))
            moves.append(Candidate(fit.effects, tuple(moved)))
    starts = np.repeat(fit.starts[None], 1 + len(moves), axis=0)
    predicted = shooting.differences.predict(shooting.segments, starts, [fit.candidate, *moves])
    return np.moveaxis(predicted[1:] - predicted[0], 0, -1)
