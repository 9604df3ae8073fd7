"""What happens between the command and the force: gain, bias, limits, dead band, delay and lag."""

from __future__ import annotations

import dataclasses
from typing import Self

import mujoco
import numpy as np
from scipy.signal import lfilter

from torch_activegp.physics.actuator import ActuatorEffect
from torch_activegp.physics.effect import Acting, Array, Parameter
from torch_activegp.physics.place import Place


def _proportional(actuator: mujoco.MjsActuator) -> bool:
    """Whether the force is a constant factor times the control, filtered perhaps, and something without it."""
    filters = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    by_ratio = actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE and actuator.biasprm[2] > 0.0  # dampratio of the gain
    return actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED and actuator.dyntype in filters and not by_ratio


def _wide(values: Array) -> Array:
    """Values ``(n,)`` against controls ``(n, runs, T)``."""
    return values[:, None, None]


class ActuatorGain(ActuatorEffect):
    """(1 + c) u: the drive is stronger or weaker than the model's."""

    name = "actuator_gain"
    law = "g u"
    order = 4

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator."""
        parameter = Parameter("excess", "1", 0.05, low=-0.95, high=9.0)
        return dataclasses.replace(cls.make(place, model, parameter, [0.05], linear=1), tunable=True)

    def control(self, control: Array, dt: Array, values: Array) -> Array:
        """Scales the control."""
        control[..., self.index] *= _wide(1.0 + values[:, 0])
        return control

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Scales ``gainprm``, where the force is proportional to the control."""
        actuator = self.actuator(spec)
        if not _proportional(actuator):
            return False
        actuator.gainprm[0] *= 1.0 + float(values[0])
        return True

    def describe(self, values: Array) -> dict[str, float]:
        """The gain, 1 for the model's own."""
        return {"gain": 1.0 + float(values[0])}


class ActuatorBias(ActuatorEffect):
    """u + b: the drive's zero is off."""

    name = "actuator_bias"
    law = "u + b"
    order = 5

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator."""
        scale = 0.05 * place.control
        made = cls.make(place, model, Parameter("bias", "1", scale), [scale], linear=1)
        return dataclasses.replace(made, tunable=True)

    def control(self, control: Array, dt: Array, values: Array) -> Array:
        """Adds to the control."""
        control[..., self.index] += _wide(values[:, 0])
        return control

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes the force of the bias into ``biasprm``, where the force is proportional to the control."""
        actuator = self.actuator(spec)
        biases = (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)
        if not _proportional(actuator) or actuator.biastype not in biases:
            return False
        actuator.biasprm[0] += float(values[0]) * self.nominal_gain
        if actuator.biastype == mujoco.mjtBias.mjBIAS_NONE:
            actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        return True


class ActuatorDeadZone(ActuatorEffect):
    """u - clip(u, -w, w): small commands do nothing."""

    name = "actuator_dead_zone"
    never_negative = frozenset({"width"})
    law = "u - clip(u, -w, w)"
    order = 3

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator."""
        top = place.control
        parameter = Parameter("width", "1", 0.03 * top, low=0.0, high=0.9 * top)
        return cls.make(place, model, parameter, [top * x for x in (0.003, 0.008, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5)])

    def control(self, control: Array, dt: Array, values: Array) -> Array:
        """Takes the dead band out."""
        u, width = control[..., self.index], _wide(np.maximum(values[:, 0], 0.0))
        control[..., self.index] = np.sign(u) * np.maximum(np.abs(u) - width, 0.0)
        return control


class ActuatorSaturation(ActuatorEffect):
    """clip(u, -limit, limit): the drive gives no more than its limit."""

    name = "actuator_saturation"
    never_negative = frozenset({"limit"})
    law = "clip(u, -limit, limit)"
    order = 6

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator."""
        top = place.control
        parameter = Parameter("limit", "1", 0.03 * top, low=0.02 * top, high=top, place=True)
        return cls.make(place, model, parameter, [top * x for x in (0.97, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2)])

    def control(self, control: Array, dt: Array, values: Array) -> Array:
        """Clips the control."""
        limit = _wide(values[:, 0])
        control[..., self.index] = np.clip(control[..., self.index], -limit, limit)
        return control

    def acts(self, values: Array) -> Acting | None:
        """Past the limit on either side."""
        within = ((float(values[0]), np.inf), (-np.inf, -float(values[0])))
        return Acting(self.drives.partition(":")[2], f"ctrl.{self.item}", within) if self.drives else None

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``forcerange`` where the control alone makes the force, else ``ctrlrange`` where nothing else acts."""
        actuator, limit = self.actuator(spec), float(values[0])
        if not _proportional(actuator):
            return False
        bias, filtered = self.nominal
        if filtered == mujoco.mjtDyn.mjDYN_NONE and not any(actuator.biasprm[1:3]):
            limit *= abs(self.nominal_gain)
            actuator.forcerange = _narrower(actuator.forcerange, actuator.forcelimited, limit, bias)
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            return True
        if (actuator.gainprm[0], actuator.biasprm[0], int(actuator.dyntype)) != (self.nominal_gain, bias, filtered):
            return False
        actuator.ctrlrange = _narrower(actuator.ctrlrange, actuator.ctrllimited, limit)
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        return True


def _narrower(limits: Array, limited: int, limit: float, center: float = 0.0) -> Array:
    """A range cut to a center +-limit; a range that is not set, or does not limit, counts as open."""
    limits_it = limits[0] < limits[1] and limited != mujoco.mjtLimited.mjLIMITED_FALSE
    low, high = limits if limits_it else (-np.inf, np.inf)
    return np.array([max(center - limit, low), min(center + limit, high)])


class ActuatorLag(ActuatorEffect):
    """First-order lag: T du'/dt = u - u', T the time constant."""

    name = "actuator_lag"
    never_negative = frozenset({"time_constant"})
    law = "T du'/dt = u - u'"
    order = 2

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator, with time constants from a third of a sample to 0.2 s."""
        seeds = np.geomspace(np.clip(place.dt / 3, 2e-3, 0.1), 0.2, 7)
        parameter = Parameter("time_constant", "s", 0.3 * place.dt, low=0.0, high=0.5)
        return cls.make(place, model, parameter, list(seeds))

    def control(self, control: Array, dt: Array, values: Array) -> Array:
        """Filters the control exactly for a control that is held in each step; gives the mean over the step."""
        held = np.moveaxis(control[..., self.index], -1, 0)
        ratio = np.moveaxis(dt, -1, 0)[:, None] / np.maximum(values[:, :1], 1e-9)
        gone = -np.expm1(-ratio)
        past = follow(held, gone) - held
        control[..., self.index] = np.moveaxis(held + past * (gone / np.maximum(ratio, 1e-300)), 0, -1)
        return control

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``dyntype filterexact``, for an actuator without activation."""
        actuator = self.actuator(spec)
        if actuator.dyntype != mujoco.mjtDyn.mjDYN_NONE:
            return False
        actuator.dyntype, actuator.actearly = mujoco.mjtDyn.mjDYN_FILTEREXACT, True
        actuator.dynprm[0] = float(values[0])
        return True


def follow(held: Array, gone: Array) -> Array:
    """What follows a control ``(T, n, runs)`` by a share of the distance in each step: its values before the steps."""
    out = np.empty_like(held)
    if np.ptp(gone, axis=0).max() < 1e-9:  # a regular clock
        for case, run in np.ndindex(held.shape[1:]):
            share, u = float(gone[0, case, run]), held[:, case, run]
            after, _ = lfilter([share], [1.0, share - 1.0], u, zi=[(1.0 - share) * u[0]])
            out[0, case, run], out[1:, case, run] = u[0], after[:-1]
        return out
    out[0] = held[0]
    for k in range(len(held) - 1):
        out[k + 1] = out[k] + gone[k] * (held[k] - out[k])
    return out


class ActuatorDelay(ActuatorEffect):
    """u(t - T): a dead time on the bus or in the drive."""

    name = "actuator_delay"
    never_negative = frozenset({"seconds"})
    law = "u(t - T)"
    order = 1

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator, with delays from half a sample to 0.15 s."""
        seeds = np.geomspace(np.clip(place.dt / 2, 2e-3, 0.1), 0.15, 8)
        parameter = Parameter("seconds", "s", 0.3 * place.dt, low=0.0, high=0.4)
        return cls.make(place, model, parameter, list(seeds))

    def control(self, control: Array, dt: Array, values: Array) -> Array:
        """Shifts the control; each step gets the mean of what reaches the machine within it."""
        for run in range(dt.shape[0]):
            edges = np.concatenate([[0.0], np.cumsum(dt[run])])
            for case, delay in enumerate(np.maximum(values[:, 0], 0.0)):
                u = control[case, run, :, self.index]
                total = np.concatenate([[0.0], np.cumsum(u * dt[run])])
                # before the run, the first control is taken to have been held
                shifted = np.interp(edges - delay, edges, total) + u[0] * np.minimum(edges - delay, 0.0)
                control[case, run, :, self.index] = np.diff(shifted) / np.maximum(dt[run], 1e-12)
        return control

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``delay``, enough ``nsample`` for it, and linear ``interp``: the mean of what arrives in a step.

        Between two samples MuJoCo's line rises before the later one, where a control is held until it. At the beginning
        of a step that makes the mean over it; Runge-Kutta looks ahead within it too, and wants half a step more.
        """
        actuator, step = self.actuator(spec), spec.option.timestep
        stages = spec.option.integrator == mujoco.mjtIntegrator.mjINT_RK4
        delay = float(values[0]) + 0.5 * step * stages
        if actuator.nsample or delay < step:  # MuJoCo's least delay is a step
            return False
        actuator.delay, actuator.interp = delay, 1
        actuator.nsample = int(np.ceil(delay / step)) + 2
        return True


ACTUATION: tuple[type[ActuatorEffect], ...] = (
    ActuatorGain,
    ActuatorBias,
    ActuatorDelay,
    ActuatorLag,
    ActuatorSaturation,
    ActuatorDeadZone,
)
"""The family, in the order in which a modeller would try them."""
