"""Effects that remember where the joint has been."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.physics.effect import Array, Effect, Index, Parameter, Place, Step, add_rotor
from torch_activegp.physics.joint import JointEffect, drivers

_SMALL = 0.05
_LIGHTEST = 0.01
_SPAN = 2


class Hysteresis(JointEffect):
    """A spring with a slider: -k z, where z follows q and slips at +-s."""

    name = "hysteresis"
    never_negative = frozenset({"stiffness", "slip"})
    law = "-k z, z follows q and slips at +-s"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint, with slips from 2 to 40 % of the range."""
        width = max(place.position[1] - place.position[0], 1e-9)
        parameters = (
            Parameter("stiffness", f"{place.force_unit}/{place.position_unit}", _SMALL * place.force / width, low=0.0),
            Parameter("slip", place.position_unit, 0.02 * width, low=2e-3 * width, high=width),
        )
        seeds = [[_SMALL * place.force / (share * width), share * width] for share in (0.02, 0.06, 0.15, 0.4)]
        return cls.make(place, parameters, seeds, linear=1)

    def memory(self, positions: Array, starts: Array, values: Array) -> Array:
        """The slider's deflection at the start of each simulation, from the run's positions up to there.

        Args:
            positions: smoothed positions of whole runs, ``(runs, T)``.
            starts: run and row at which each simulation starts, ``(rows, 2)``.
            values: ``(rows, P)``.

        Returns:
            Deflection and last position, ``(rows, 2)``.
        """
        slips, which = np.unique(values[:, 1], return_inverse=True)
        deflection = np.zeros((len(slips), *positions.shape))
        for k in range(1, positions.shape[1]):
            moved = deflection[:, :, k - 1] + (positions[:, k] - positions[:, k - 1])
            deflection[:, :, k] = np.clip(moved, -slips[:, None], slips[:, None])
        run, row = starts[:, 0], starts[:, 1]
        return np.stack([deflection[which, run, row], positions[run, row]], axis=1)

    def path(self, position: Array, values: Array) -> Array:
        """The force along given positions ``(n, T)``, with the slider's deflection zero in the beginning."""
        deflection = np.zeros_like(position)
        for k in range(1, position.shape[1]):
            moved = deflection[:, k - 1] + position[:, k] - position[:, k - 1]
            deflection[:, k] = np.clip(moved, -values[1], values[1])
        return -values[0] * deflection

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Moves the slider and adds the spring's force."""
        assert memory is not None
        position = step.qpos[rows, self.qpos]
        moved = memory[:, 0] + position - memory[:, 1]
        memory[:, 0] = np.minimum(np.maximum(moved, -values[:, 1]), values[:, 1])
        memory[:, 1] = position
        step.force[rows, self.dof] -= values[:, 0] * memory[:, 0]


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
        drives: control, force for one unit of it, force without it, and largest force, for each motor on the joint.
        dt: time between the rows of a recording, s.

    Reference: Stewart and Trinkle 1996, time stepping with contact at the level of velocities.
    """

    dof: int = 0
    qpos: int = 0
    rotor: float = 1.0
    armature: float = 1.0
    drives: tuple[tuple[int, float, float, float], ...] = ()
    dt: float = 0.01

    name = "backlash"
    never_negative = frozenset({"gap"})
    law = "the motor's torque reaches the joint only at the ends of a gap"
    needs_steps = True

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
            rotor=max(armature, _LIGHTEST / max(float(model.dof_invweight0[place.index]), 1e-12)),
            armature=armature,
            drives=tuple(drives),
            dt=place.dt,
        )

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Takes the rotor off the joint."""
        add_rotor(field, rows, self.dof, np.full(len(rows), -self.armature))
        return False

    def memory(self, positions: Array, starts: Array, values: Array) -> Array:
        """The rotor: position, speed, speed without contact, speed against the joint, side, time step.

        None of it is known yet: the first step puts the rotor to the side where it must push to keep up with the
        joint's acceleration, which stands in the place of its speed until then.
        """
        run, row = starts[:, 0], np.clip(starts[:, 1], _SPAN, max(positions.shape[1] - 1 - _SPAN, _SPAN))
        memory = np.full((len(starts), 6), np.nan)
        if positions.shape[1] > 2 * _SPAN:
            ends = positions[run, row + _SPAN] + positions[run, row - _SPAN]
            memory[:, 1] = (ends - 2.0 * positions[run, row]) / (_SPAN * self.dt) ** 2
        else:
            memory[:, 1] = 0.0
        return memory

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Moves the rotor to the start of the step, finds whether it touches, and exchanges force."""
        assert memory is not None
        q, v, dt = step.qpos[rows, self.qpos], step.qvel[rows, self.dof], step.dt[rows]
        torque, half = self._torque(step.ctrl[rows]), 0.5 * values[:, 0]
        new = np.isnan(memory[:, 4])
        if new.any():
            side = np.where(torque < self.rotor * memory[:, 1], -1.0, 1.0)
            memory[new] = np.stack([q + side * half, v, v, 0.0 * v, side, 0.0 * v], axis=1)[new]
            add_rotor(step.field, rows[new], self.dof, np.full(int(new.sum()), self.rotor))
        place, before, free, apart, side, last = memory.T
        pulled = side * (free - v - apart) < 0.0
        held = (side != 0.0) & ~pulled
        back = np.where(pulled, self.rotor * (v + apart - free) / dt, 0.0)
        speed = np.where(held, v + apart, free)
        off = np.where(held, side * half, place + 0.5 * last * (before + free) - q)
        free = speed + dt * torque / self.rotor
        then = off + dt * (free - v)
        now = np.where(held, side, np.sign(then) * (np.abs(then) >= half))
        apart = np.where(now != 0.0, (now * half - off) / dt, 0.0)
        add_rotor(step.field, rows, self.dof, self.rotor * (np.abs(now) - np.abs(side)))
        step.force[rows, self.dof] += back + np.where(now != 0.0, self.rotor * (speed - v - apart) / dt, -torque)
        memory[:] = np.stack([q + off, speed, free, apart, now, dt], axis=1)

    def _torque(self, ctrl: Array) -> Array:
        forces = [np.clip(factor * ctrl[:, i] + bias, -most, most) for i, factor, bias, most in self.drives]
        return np.sum(forces, axis=0)


def _constant_bias(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Actuators whose bias is a constant: no feedback of position or speed."""
    affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
    return np.asarray(affine & ~model.actuator_biasprm[:, 1:3].any(axis=1))


MEMORY: tuple[type[Effect], ...] = (Hysteresis,)
"""The family, on every joint; :class:`Backlash` is for those with a motor."""
