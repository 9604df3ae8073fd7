"""Drives of the model that filter their own control: taken out of the simulation, and applied to whole runs exactly.

MuJoCo keeps the filtered control as an activation, which is part of its state: no recording holds it, a segment that
begins in the middle of a run does not know it, and a time step acts by its value at the beginning of the step, half a
step late. The filter depends on the control alone, so it can go before the simulation.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from torch_activegp.diagnosis.runs import Array
from torch_activegp.physics.actuation import ActuatorLag
from torch_activegp.physics.effect import Place

_FIRST_ORDER = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))


class OwnFilter(NamedTuple):
    """A filter of first order in the model.

    Args:
        lag: the law.
        actuator: which actuator has it.
        time_constant: s.
    """

    lag: ActuatorLag
    actuator: int
    time_constant: float

    def apply(self, control: Array, dt: Array) -> None:
        """Filters controls of whole runs in place.

        Before a run, its first control is taken to have been held.

        Args:
            control: in each time step, ``(n, runs, T, nu)``; becomes the mean of what acts in it.
            dt: lengths of the steps, ``(runs, T)``, s.
        """
        self.lag.control(control, dt, np.full((len(control), 1), self.time_constant))


def own_filters(model: mujoco.MjModel) -> tuple[OwnFilter, ...]:
    """The filters of first order in a model whose state has no limits of its own."""
    found = []
    for i in range(model.nactuator):
        simple = model.actuator_actadr[i] >= 0 and model.actuator_actnum[i] == 1 and not model.actuator_actlimited[i]
        if simple and model.actuator_dyntype[i] in _FIRST_ORDER and model.actuator_ctrlnum[i] == 1:
            place = Place(f"actuator:{model.actuator(i).name or f'actuator{i}'}", int(model.actuator_ctrladr[i]))
            found.append(OwnFilter(ActuatorLag.at(place, model), i, float(model.actuator_dynprm[i, 0])))
    return tuple(found)


def without_filters(model: mujoco.MjModel, filters: tuple[OwnFilter, ...]) -> None:
    """Lets the controls of some actuators act at once, in place."""
    for own in filters:
        model.actuator_dyntype[own.actuator] = int(mujoco.mjtDyn.mjDYN_NONE)
        model.actuator_actadr[own.actuator] = -1
        model.actuator_actnum[own.actuator] = 0
