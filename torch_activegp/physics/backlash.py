"""Play between a motor and its joint."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.physics.effect import Array, Effect, Index, Parameter, Step
from torch_activegp.physics.joint import drivers
from torch_activegp.physics.place import Place
from torch_activegp.physics.rotor import Motion, Past, add_rotor, carried, whole_inertia

_LIGHTEST = 0.01
_NO_GAP, _UNSEEN = 1e-5, 0.3
"""Part of the joint's range that is no gap: a fiftieth of the smallest one that a search begins from. And part of the
noise: gaps that were there were 3.3 of it at least in nine cases, and one of 0.09 stood for numerics."""
_SPAN = 2
_BACK, _FINE, _ROUNDING = 2.0, 2.5e-3, 1e-6
"""How long a rotor is carried along a recording before a simulation, and in about what steps, s."""


@dataclasses.dataclass(frozen=True, eq=False)
class Backlash(Effect):
    """Play between a motor and its joint: the motor's torque reaches the joint only at the ends of a gap.

    The rotor is a second mass inside the effect, with the inertia that the model has as ``armature``. In each step it
    is either free, or held at one end of the gap: then its inertia stands in ``dof_armature`` again, and an impulse
    makes up for the difference in speed. A hold that would have pulled is given back one step later.

    Args:
        dof: degree of freedom in the model.
        qpos: address of the position.
        rotor: inertia of the rotor, kg m2 or kg.
        armature: the part of it that the model has already.
        drag: the part of the joint's viscous damping that is the rotor's, N m s/rad or N s/m.
        drives: control, force for one unit of it, force without it, and largest force, for each motor on the joint.
        dt: time between the rows of a recording, s.
        least: what is narrower is no gap, rad or m.
        centred: whether the rotor begins a recording in the middle of the gap, at the speed of the joint; else on the
            side where it must push to keep up.
        on_motor: whether the encoder sits on the motor: then what is recorded of the joint, and so its state as
            simulations begin and where they are read, is the rotor's, and the joint itself is hidden.

    Reference: Stewart and Trinkle 1996, time stepping with contact at the level of velocities.
    """

    dof: int = 0
    qpos: int = 0
    rotor: float = 1.0
    armature: float = 1.0
    drag: float = 0.0
    drives: tuple[tuple[int, float, float, float], ...] = ()
    dt: float = 0.01
    least: float = 0.0
    centred: bool = False
    on_motor: bool = False

    name = "backlash"
    never_negative = frozenset({"gap"})
    law = "the motor's torque reaches the joint only at the ends of a gap"
    needs_steps = True
    needs_past = True
    strikes = True

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether motors without activation and without feedback drive the joint, and nothing else does."""
        on = drivers(place, model)
        plain = (
            (model.actuator_gaintype[on] == mujoco.mjtGain.mjGAIN_FIXED)
            & ((model.actuator_biastype[on] == mujoco.mjtBias.mjBIAS_NONE) | _constant_bias(model)[on])
            & (model.actuator_dyntype[on] == mujoco.mjtDyn.mjDYN_NONE)
        )
        return bool(len(on)) and bool(plain.all())

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`, with gaps from 0.05 to 20 % of the range."""
        width = max(place.position[1] - place.position[0], 1e-9)
        armature = float(model.dof_armature[place.index])
        drives = []
        for i in drivers(place, model):
            gear, strength = model.actuator_gear[i, 0], model.actuator_gainprm[i, 0]
            most = abs(gear) * model.actuator_forcerange[i, 1] if model.actuator_forcelimited[i] else np.inf
            bias = model.actuator_biasprm[i, 0] if _constant_bias(model)[i] else 0.0
            drives.append((int(model.actuator_ctrladr[i]), float(gear * strength), float(gear * bias), float(most)))
        return cls(
            place.target,
            (Parameter("gap", place.position_unit, 0.01 * width, low=0.0, high=width),),
            np.array([[share * width] for share in (5e-4, 1.5e-3, 5e-3, 0.015, 0.04, 0.1, 0.2)]),
            linear=0,
            dof=place.index,
            qpos=place.qpos,
            rotor=max(armature, _LIGHTEST * whole_inertia(model, place.index)),
            armature=armature,
            drives=tuple(drives),
            dt=place.dt,
            least=max(_NO_GAP * width, _UNSEEN * place.noise),
            centred=True,
        )

    def plausible(self, values: Array) -> bool:
        """Whether there is a gap: none at all is another way to compute the same drive, or one that gives way."""
        return bool(values[0] >= self.least)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Takes the rotor off the joint; its drag follows with the first step, for a leapfrog looks at it before."""
        add_rotor(field, rows, self.dof, np.full(len(rows), -self.armature))
        return False

    def memory(self, positions: Array, starts: Array, values: Array, past: Past | None = None) -> Array:
        """The rotor: position, speed, speed without contact, speed against the joint, side, time step.

        The first step finds in their place the joint's acceleration, and where the rotor is against the joint, how
        fast, and on which side: carried along the recording for a while before, where there is any. Where there is
        none, the last three are no numbers if it begins on the side where it must push to keep up with the joint.
        """
        every = max(int(_FINE / self.dt), 1)
        even = np.broadcast_to(self.dt * np.arange(positions.shape[1]), positions.shape)
        motion = Motion.along(positions, even if past is None else past.time, _SPAN)
        memory = np.full((len(starts), 6), np.nan)
        memory[:, 0] = motion.acceleration[starts[:, 0], np.minimum(starts[:, 1], positions.shape[1] - 1)]
        if self.centred:
            memory[:, 1:4] = 0.0
        back = min(int(np.ceil(_BACK / (every * self.dt))), -(-int(starts[:, 1].max()) // every))
        if past is not None and back and not self.on_motor:
            alike = np.column_stack([past.same, starts, values[:, 0]])  # most differ in their initial states alone
            _, one, of = np.unique(alike, axis=0, return_index=True, return_inverse=True)
            control = past.control(one, back * every).reshape(len(one), back, every, -1).mean(axis=2)
            rows = starts[one, 1:] + every * np.arange(-back, 1)
            before = motion.at(starts[one, 0], rows)
            memory[:, 1:4] = self._carried(before, rows, self._torque(control), values[one, 0])[of.reshape(-1)]
        return memory

    def _carried(self, before: Motion, rows: Array, torque: Array, gap: Array) -> Array:
        """Where rotors are against their joints, how fast, and on which side, ``(n, 3)``.

        Args:
            before: the joint's motion.
            rows: at these of a recording, ``(n, B + 1)``; it has not begun at those below zero.
            torque: between them, ``(n, B)``.
            gap: ``(n,)``.
        """
        begun = rows[:, :-1] >= 0
        centred = (rows[:, 0] <= 0) & self.centred
        parts = max(math.ceil(self.dt / _FINE - _ROUNDING), 1)
        found = np.stack(carried(before, torque, begun, self.rotor, 0.5 * gap, parts, centred, self.drag), axis=1)
        return np.where(begun.any(axis=1, keepdims=True), found, 0.0 if self.centred else np.nan)

    def anew(self) -> Self:
        """With the rotor where it pushes: from the middle of the gap no single step would feel the motor."""
        return dataclasses.replace(self, centred=False)

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Moves the rotor to the start of the step, finds whether it touches, and exchanges force."""
        assert memory is not None
        q, v, dt = step.qpos[rows, self.qpos], step.qvel[rows, self.dof], step.dt[rows]
        torque, half = self._torque(step.ctrl[rows]), 0.5 * values[:, 0]
        new = np.isnan(memory[:, 4])
        if new.any():
            off, faster, side = self._begin(memory, torque - self.drag * v)
            off, faster = np.where(side != 0.0, side * half, off), np.where(side != 0.0, 0.0, faster)
            q = self._joint_behind(step, rows, new, q, off)
            memory[new] = np.stack([q + off, v + faster, v + faster, 0.0 * v, side, 0.0 * v], axis=1)[new]
            inertia, drag = self._on_joint(np.abs(side[new]))
            add_rotor(step.field, rows[new], self.dof, inertia, drag - self.drag)
        free, apart, side = memory.T[2:5]
        off, speed, held = self._rotor(q, v, half, memory)
        back = np.where((side != 0.0) & ~held, self.rotor * (v + apart - free) / dt, 0.0)
        free = (speed + dt * torque / self.rotor) / (1.0 + dt * self.drag / self.rotor)
        late = step.middle * (free - v)  # a touch acts in the middle of a step, half a step too late on average
        then = off + dt * (free - v + late)
        now = np.where(held, side, np.sign(then) * (np.abs(then) >= half))
        apart = np.where(now != 0.0, (now * half - off) / dt - np.where(held, 0.0, late), 0.0)
        met = np.abs(now) - np.abs(side)
        if met.any():
            add_rotor(step.field, rows, self.dof, *self._on_joint(met))
        step.force[rows, self.dof] += back + np.where(now != 0.0, self.rotor * (speed - v - apart) / dt, -torque)
        for column, told in enumerate((q + off, speed, free, apart, now, dt)):
            memory[:, column] = told

    def show(self, qpos: Array, qvel: Array, rows: Index, values: Array, memory: Array | None) -> None:
        """Puts the rotor in place of the joint where the encoder sits on it."""
        if self.on_motor and memory is not None:
            q, v = qpos[rows, self.qpos], qvel[rows, self.dof]
            off, speed, _ = self._rotor(q, v, 0.5 * values[:, 0], memory)
            qpos[rows, self.qpos], qvel[rows, self.dof] = q + off, speed

    def _rotor(self, q: Array, v: Array, half: Array, memory: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Where the rotor is against the joint after a step, its speed, and whether it is held at an end of the gap."""
        place, before, free, apart, side, last = memory.T
        held = (side != 0.0) & ~(side * (free - v - apart) < 0.0)  # also where a simulation failed
        off = np.where(held, side * half, place + 0.5 * last * (before + free) - q)
        return off, np.where(held, v + apart, free), held

    def _joint_behind(self, step: Step, rows: Index, new: NDArray[np.bool_], q: Array, off: Array) -> Array:
        """Position of the joint as simulations begin: it is put behind the rotor where the encoder sees that."""
        if self.on_motor:
            q = np.where(new, q - off, q)
            step.qpos[rows, self.qpos] = q
        return q

    def _on_joint(self, share: Array) -> tuple[Array, Array]:
        """Inertia and damping of a rotor that moves with the joint."""
        return self.rotor * share, self.drag * share

    def _begin(self, memory: Array, torque: Array) -> tuple[Array, Array, Array]:
        """The rotor's offset from the joint, speed against it and side, before the first step."""
        acceleration, off, faster, side = memory.T[:4]
        side = np.where(np.isnan(side), np.where(torque < self.rotor * acceleration, -1.0, 1.0), side)
        return off, faster, side

    def _torque(self, ctrl: Array) -> Array:
        torque = np.zeros(ctrl.shape[:-1])
        for i, factor, bias, most in self.drives:  # np.clip takes four times as long
            torque += np.minimum(np.maximum(factor * ctrl[..., i] + bias, -most), most)
        return torque


@dataclasses.dataclass(frozen=True, eq=False)
class RestingBacklash(Backlash):
    """The same with a rotor that begins a recording on the side where it must push to keep up with the joint."""

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`."""
        return dataclasses.replace(super().at(place, model), variant="resting", stands_in=True, centred=False)


@dataclasses.dataclass(frozen=True, eq=False)
class DampedBacklash(Backlash):
    """The same where the joint's damping is that of the motor and its gears, on the rotor's side of the gap."""

    law = "the motor's torque reaches the joint only at the ends of a gap, and the joint's damping acts on the motor"

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the joint has viscous damping too."""
        return super().fits(place, model) and bool(model.dof_damping[place.index] > 0.0)

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`."""
        drag = float(model.dof_damping[place.index])
        return dataclasses.replace(super().at(place, model), variant="damped rotor", stands_in=True, drag=drag)


def _constant_bias(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Actuators whose bias is a constant: no feedback of position or speed."""
    affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
    return np.asarray(affine & ~model.actuator_biasprm[:, 1:3].any(axis=1))


BACKLASH: tuple[type[Backlash], ...] = (Backlash, RestingBacklash, DampedBacklash)
"""The family, on joints with a motor; with ends that give way in :mod:`torch_activegp.physics.springy_backlash`, and
with the encoder on the motor in :mod:`torch_activegp.physics.motor_side`."""
