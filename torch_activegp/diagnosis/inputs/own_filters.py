"""Drives of the model that filter their own control.

MuJoCo keeps the filtered control as an activation, which is part of its state: no recording holds it, and a segment
that begins in the middle of a run does not know it. The filter depends on the control alone. So either each segment
begins with the state that the control before it leads to, and MuJoCo steps it on; or the filter goes before the
simulation and is exact, where MuJoCo acts by its state at the beginning of each step, half a step late.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array, Run
from torch_activegp.errors import ConfigurationError
from torch_activegp.physics.actuation import ActuatorLag, follow
from torch_activegp.physics.naming import actuator_name
from torch_activegp.physics.place import Place

_FIRST_ORDER = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_MOTOR = 'Make it a motor (dyntype="none") and record what it puts out.'
_INTEGRATED = (
    'Give its control\'s integral, from where it began, to a drive without a state (dyntype="none"): an `intvelocity` '
    "becomes a `position` servo, whose control is where it leads."
)
"""What to do instead of a drive with a state, and of one that integrates."""


class OwnFilter(NamedTuple):
    """A filter of first order in the model.

    Args:
        lag: the law.
        actuator: which actuator has it.
        time_constant: s.
        address: of its state among MuJoCo's activations.
        exact: whether MuJoCo steps it exactly (``filterexact``), or by Euler (``filter``).
        runge_kutta: whether the model is integrated so.
        empty: whether each run begins with nothing in it, as a simulation does, and not as if its first control had
            been held before, as on a machine at rest.
    """

    lag: ActuatorLag
    actuator: int
    time_constant: float
    address: int
    exact: bool
    runge_kutta: bool
    empty: bool = False

    def apply(self, control: Array, dt: Array) -> None:
        """Filters controls of whole runs in place.

        Args:
            control: in each time step, ``(n, runs, T, nu)``; becomes the mean of what acts in it.
            dt: lengths of the steps, ``(runs, T)``, s.
        """
        first = control[:, :, :1, self.lag.index].copy()
        self.lag.control(control, dt, np.full((len(control), 1), self.time_constant))
        if self.empty:
            ratio = dt / max(self.time_constant, 1e-9)
            control[..., self.lag.index] -= first * np.exp(ratio - np.cumsum(ratio, axis=1)) * -np.expm1(-ratio) / ratio

    def states(self, control: Array, dt: Array) -> Array:
        """The filtered control before each time step, as MuJoCo steps it, ``(n, runs, T)``; see :meth:`apply`."""
        held = np.moveaxis(control[..., self.lag.index], -1, 0)
        ratio = np.moveaxis(dt, -1, 0)[:, None] / max(self.time_constant, 1e-9)
        slope = 1.0 - ratio / 2 + ratio**2 / 6 - ratio**3 / 24 if self.runge_kutta else 1.0  # mean over the stages
        gone = np.broadcast_to(slope * (-np.expm1(-ratio) if self.exact else ratio), held.shape)
        before = follow(held, gone)
        if self.empty:
            before -= held[0] * np.concatenate([np.ones_like(gone[:1]), np.cumprod(1.0 - gone[:-1], axis=0)])
        return np.moveaxis(before, 0, -1)


def own_filters(model: mujoco.MjModel) -> tuple[OwnFilter, ...]:
    """The filters of first order in a model whose state has no limits of its own."""
    found = []
    for i in range(model.nactuator):
        simple = model.actuator_actadr[i] >= 0 and model.actuator_actnum[i] == 1 and not model.actuator_actlimited[i]
        if simple and model.actuator_dyntype[i] in _FIRST_ORDER and model.actuator_ctrlnum[i] == 1:
            place = Place(f"actuator:{actuator_name(model, i)}", int(model.actuator_ctrladr[i]))
            exact = model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_FILTEREXACT
            constant, address = float(model.actuator_dynprm[i, 0]), int(model.actuator_actadr[i])
            stages = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
            found.append(OwnFilter(ActuatorLag.at(place, model), i, constant, address, bool(exact), bool(stages)))
    return tuple(found)


def check_drives(model: mujoco.MjModel, runs: Sequence[Run]) -> None:
    """Refuses drives with a state that neither a recording holds nor the recorded control tells.

    Raises:
        ConfigurationError: such a drive was used: an integrator, a muscle, a PID controller, or a filter whose state
            has limits.
    """
    known = {own.actuator for own in own_filters(model)}
    for i in np.flatnonzero(model.actuator_actadr >= 0):
        kind, inputs = mujoco.mjtDyn(int(model.actuator_dyntype[i])), np.arange(model.actuator_ctrlnum[i])
        used = any(run.control[:, model.actuator_ctrladr[i] + inputs].any() for run in runs)
        if used and int(i) not in known and kind != mujoco.mjtDyn.mjDYN_DCMOTOR:
            raise ConfigurationError(
                f"actuator `{actuator_name(model, i)}`: a drive without a state, a filter of first "
                f"order without limits, or a dcmotor wanted, found `{kind.name.removeprefix('mjDYN_').lower()}`: no "
                f"recording holds its state. {_INTEGRATED if kind == mujoco.mjtDyn.mjDYN_INTEGRATOR else _MOTOR}"
            )


def without_filters(model: mujoco.MjModel, filters: tuple[OwnFilter, ...]) -> None:
    """Lets the controls of some actuators act at once, in place."""
    for own in filters:
        model.actuator_dyntype[own.actuator] = int(mujoco.mjtDyn.mjDYN_NONE)
        model.actuator_actadr[own.actuator] = -1
        model.actuator_actnum[own.actuator] = 0
