"""A simulator that only returns its next state: how it is read, and what an effect means on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run
from torch_activegp.errors import ActiveGPError, ConfigurationError, DataError, SimulationError
from torch_activegp.physics import Effect
from torch_activegp.physics.actuator import ActuatorEffect
from torch_activegp.physics.bristles import BRISTLED_FORMS
from torch_activegp.physics.inertia import ArmatureError
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.sensing import SensorEffect
from torch_activegp.physics.soft_friction import SoftCoulombFriction
from torch_activegp.physics.springs import ConstantForce
from torch_activegp.simulators import Simulator
from torch_activegp.simulators.load import USER_FAULTS

_CLOSE = 1e-3
_UNEVEN = 0.5
_ALIKE = 0.5
_ROWS = 2000
_UNITS = {
    "N m": "rad/s2",
    "N": "m/s2",
    "N m s/rad": "1/s",
    "N s/m": "1/s",
    "N m s2/rad2": "1/rad",
    "N s2/m2": "1/m",
    "N m/rad": "1/s2",
    "N/m": "1/s2",
    "N m/rad3": "1/(rad2 s2)",
    "N/m3": "1/(m2 s2)",
}
"""Units of forces and their coefficients, and the same per unit of inertia."""


@dataclasses.dataclass(frozen=True, eq=False)
class BlackBox:
    """A simulator whose state is positions and their velocities, and nothing else is known of it.

    Args:
        simulator: the map to the next state.
        name: for people.
        order: where the n positions stand in its state, and after them their velocities, ``(2 n,)``.
        model: names, addresses and limits of it as a MuJoCo model of n free unit inertias, which is never stepped.
        dtype: that the simulator computes in: float64 where it can.
    """

    simulator: Simulator
    name: str
    order: NDArray[np.int64]
    model: mujoco.MjModel
    dtype: torch.dtype

    @classmethod
    def of(cls, simulator: Simulator) -> BlackBox:
        """Reads a simulator.

        Names are ``qpos.JOINT``, ``qvel.JOINT`` and ``ctrl.ACTUATOR``, in any order; or any, with the positions first
        and after them the velocities, and then the positions' names are those of the joints. A joint is in rad where
        the state space has its position on a circle, else in m.

        Raises:
            ConfigurationError: the state is not positions and as many velocities.
            SimulationError: the simulator fails, or returns something else than next states.
        """
        joints, order = _layout(simulator)
        turning = [bool(index in simulator.state_space.angles) for index in order[: len(joints)]]
        name, model = type(simulator).__name__, _stand_in(simulator, joints, turning)
        try:
            box = cls(simulator, name, order, model, torch.float64)
            box.step(np.zeros((2, len(order))), np.zeros((2, model.nu)))
        except SimulationError:
            box = cls(simulator, name, order, model, torch.float32)
            box.step(np.zeros((2, len(order))), np.zeros((2, model.nu)))
        return box

    def step(self, states: Array, control: Array) -> Array:
        """Advances states by the simulator's time step.

        Args:
            states: positions, angles of any number of turns, and velocities, ``(R, 2 n)``.
            control: actions ``(R, m)``.

        Returns:
            The next states, ``(R, 2 n)``, angles without leaps; not finite where a sample diverges.

        Raises:
            SimulationError: the simulator fails, or returns something else than next states.
        """
        space = self.simulator.state_space
        state = np.empty_like(states)
        state[:, self.order] = states
        with torch.no_grad():
            before = space.wrap(torch.from_numpy(state).to(space.low.device, self.dtype))
            action = torch.from_numpy(np.ascontiguousarray(control)).to(before)
            try:
                after = self.simulator.step(before, action)
            except USER_FAULTS as error:
                what = str(error) if isinstance(error, ActiveGPError) else f"{type(error).__name__}: {error}"
                raise SimulationError(
                    f"{self.name} failed for states {tuple(before.shape)} and actions {tuple(action.shape)}: {what}"
                ) from error
            if not isinstance(after, Tensor) or after.shape != before.shape:
                found = f"shape {tuple(after.shape)}" if isinstance(after, Tensor) else f"a {type(after).__name__}"
                raise SimulationError(
                    f"{self.name}: the next states {tuple(before.shape)} wanted, found {found}. Return one tensor."
                )
            change = space.difference(after, before)
        return np.asarray(states + change.to("cpu", torch.float64).numpy()[:, self.order])

    def notes(self) -> list[str]:
        """What an effect means on this simulator, in sentences."""
        hinge = self.model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)
        names = np.array([self.model.joint(i).name for i in range(self.model.njnt)])
        units = [f"{', '.join(names[some])} in {unit}" for some, unit in ((hinge, "rad"), (~hinge, "m")) if some.any()]
        return [
            f"{self.name} only returns its next state: effects act as accelerations of its velocities, so parameters "
            "are per unit of inertia (rad/s2 or m/s2 for a force, 1/s for a viscous coefficient).",
            f"What is wrong in {self.name}'s own inertia, weight, integrator or time step of {self.simulator.dt:g} s "
            "is not on the list for such a simulator, and may look like an effect that is.",
            f"Taken from the state space of {self.name}: {'; '.join(units)} (rad where a position is on a circle).",
        ]


def _layout(simulator: Simulator) -> tuple[list[str], NDArray[np.int64]]:
    """Names of the joints, and the indices of their positions and velocities."""
    names = list(simulator.state_space.names)
    if any(name.startswith(("qpos.", "qvel.")) for name in names):
        joints = [name.removeprefix("qpos.") for name in names if name.startswith("qpos.")]
        wanted = [f"{kind}.{joint}" for kind in ("qpos", "qvel") for joint in joints]
    else:
        joints, wanted = names[: len(names) // 2], names
    fits = sorted(wanted) == sorted(names) and len(names) == 2 * len(joints) and bool(joints)
    if not fits or simulator.state_space.quaternions:
        raise ConfigurationError(
            f"diagnose: a state of positions and their velocities wanted from a {type(simulator).__name__} (qpos.JOINT "
            f"and qvel.JOINT, or positions first and then as many velocities), found {', '.join(names)}. Give it such "
            "a state, or learn what is missing (`torch-activegp learn`)."
        )
    return joints, np.array([names.index(name) for name in wanted], dtype=np.int64)


def _stand_in(simulator: Simulator, joints: Sequence[str], turning: Sequence[bool]) -> mujoco.MjModel:
    """Free unit inertias with the names and limits of a simulator.

    What the simulator has of damping and springs itself is not known, so the model holds an endless amount: an effect
    may take any of it away. Dry friction can only be added.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = simulator.dt
    for joint, turns in zip(joints, turning, strict=True):
        body = spec.worldbody.add_body(mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
        body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE)
    space = simulator.action_space
    for name, low, high in zip(space.names, space.low.tolist(), space.high.tolist(), strict=True):
        drive = spec.add_actuator(name=name.removeprefix("ctrl."), trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joints[0])
        limited = bool(np.isfinite(low) and np.isfinite(high) and low < high)
        drive.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE if limited else mujoco.mjtLimited.mjLIMITED_FALSE
        drive.ctrlrange = [low, high] if limited else [0.0, 0.0]
    model = spec.compile()
    for own in ("dof_damping", "dof_dampingpoly", "jnt_stiffness", "jnt_stiffnesspoly"):
        getattr(model, own)[:] = np.inf
    return model


def accelerations(effects: Sequence[Effect]) -> list[Effect]:
    """The effects that can act on a black box, with the units of accelerations.

    These are laws on a joint, and what happens to controls and readings; not what changes masses, or stands between a
    motor and its joint. Which control drives which joint is not known.
    """
    kept = [e for e in effects if isinstance(e, (JointEffect, ActuatorEffect, SensorEffect))]
    kept = [dataclasses.replace(e, drives="") if isinstance(e, ActuatorEffect) else e for e in kept]
    kept = [dataclasses.replace(e, tunable=False) if isinstance(e, ConstantForce) else e for e in kept]
    return [
        _as_acceleration(e) for e in kept if not isinstance(e, (ArmatureError, SoftCoulombFriction, *BRISTLED_FORMS))
    ]


def _as_acceleration(effect: Effect) -> Effect:
    parameters = tuple(dataclasses.replace(p, unit=_UNITS.get(p.unit, p.unit)) for p in effect.parameters)
    more = None if effect.more is None else _as_acceleration(effect.more)
    return dataclasses.replace(effect, parameters=parameters, more=more)


def check_recordings(box: BlackBox, recordings: Sequence[Recording]) -> None:
    """Checks that recordings hold nothing that a black box cannot take.

    Raises:
        DataError: one holds an external force, or prescribes the motion of a joint.
    """
    for recording in recordings:
        if recording.prescribed:
            raise DataError(
                f"{recording.label}: `{recording.prescribed[0]}` is said to be prescribed, and {box.name} only returns "
                "its next state, so no joint of it can be held to a motion. Give an MJCF model, or make the motion an "
                "action of the simulator."
            )
        forces = [column for column in recording.columns if column.startswith("qfrc.")]
        if forces:
            raise DataError(
                f"{recording.label}, column `{forces[0]}`: a control of {box.name} wanted, found an external force, "
                "which it does not take. Make the force an action of the simulator and the column a ctrl column."
            )


def check_clock(box: BlackBox, runs: Sequence[Run]) -> int:
    """Checks that rows lie on the clock of a black box, whose time step is given.

    Returns:
        Time steps in each interval between rows.

    Raises:
        DataError: a run's interval is not one, two, three ... time steps, differs from the others', or is uneven.
    """
    dt, steps = box.simulator.dt, [float(np.median(run.dt)) for run in runs]
    counts = [max(round(step / dt), 1) for step in steps]
    for run, step, count in zip(runs, steps, counts, strict=True):
        off = [abs(interval / (count * dt) - 1.0) for interval in (step, float(run.dt.mean()))]
        if min(off) > _CLOSE and off[1] * len(run) > _UNEVEN:  # of uneven rows, no single interval fits
            raise DataError(
                f"{run.label}: rows every {dt:g} s (the time step of {box.name}) or a multiple of it wanted, found "
                f"every {step:g} s. Give the simulator a time step that fits, for example {step:g} s, or resample the "
                "recording."
            )
        if count != counts[0]:
            raise DataError(
                f"{run.label}: rows every {counts[0] * dt:g} s as in {runs[0].label} wanted, found every {step:g} s. "
                "Resample the recordings to one interval, or diagnose them apart."
            )
        if np.abs(run.dt - count * dt).max() > _UNEVEN * count * dt:
            raise DataError(
                f"{run.label}: rows every {count * dt:g} s wanted, found intervals from {run.dt.min():g} to "
                f"{run.dt.max():g} s. Resample the recording to even intervals."
            )
    return counts[0]


def check_rates(box: BlackBox, channels: Channels, runs: Sequence[Run]) -> None:
    """Checks on recorded motions that the simulator's velocities are the rates of its positions.

    Raises:
        ConfigurationError: they are not, for a recorded joint.
    """
    n, every = box.model.nq, max(sum(len(run) for run in runs) // _ROWS, 1)
    position = np.concatenate([run.smooth[:-1] for run in runs])[::every]
    states = np.zeros((len(position), 2 * n))
    states[:, channels.qpos] = position
    states[:, n + channels.dof] = np.concatenate([run.velocity[:-1] for run in runs])[::every]
    after = box.step(states, np.concatenate([run.control for run in runs])[::every])
    rate = (after - states)[:, channels.qpos] / box.simulator.dt
    speed = 0.5 * (after + states)[:, n + channels.dof]
    for joint, a, b in zip(channels.joints, rate.T, speed.T, strict=True):
        usable = np.isfinite(a) & np.isfinite(b)
        if np.linalg.norm((a - b)[usable]) > _ALIKE * max(np.linalg.norm(a[usable]), np.linalg.norm(b[usable])):
            raise ConfigurationError(
                f"diagnose: the velocity of `{joint}` wanted as the rate of its position (rad and rad/s, or m and "
                f"m/s), found that {box.name} moves the position otherwise. Check the order and the units of its state."
            )
