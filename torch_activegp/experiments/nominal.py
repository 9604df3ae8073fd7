"""The nominal simulator that a user names, at the time step of the recordings."""

from __future__ import annotations

import math

from torch_activegp.data.known_sets import KNOWN_MODELS, known_model
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import MujocoSimulator, Simulator, load_simulator
from torch_activegp.simulators.load import is_factory
from torch_activegp.simulators.mujoco_model import load_model

_SAME = 1e-6


def nominal_simulator(model: str, dt: float | None = None, *, external_force: bool = False) -> Simulator:
    """The simulator that a user names, brought to a time step.

    An MJCF model takes any step: as many of its own time steps as are needed, a little shortened where ``dt`` is no
    multiple of them. A factory's simulator has the step that its author gave it.

    Args:
        model: an MJCF file, ``package.module:factory``, or the name of a public data set
            (:data:`~torch_activegp.data.known_sets.KNOWN_MODELS`), for its nominal model.
        dt: time between two states, s; None leaves the model's own.
        external_force: append the joints' generalised forces to the action of an MJCF model.

    Raises:
        ConfigurationError: there is no such model, it has inner states that no recording holds, or a factory's
            simulator has another time step.

    Example:
        >>> simulator = nominal_simulator("emps", dt=0.0505)
        >>> simulator.frame_skip, round(simulator.model.opt.timestep, 6), simulator.dt
        (51, 0.00099, 0.0505)
    """
    if is_factory(model):
        simulator = load_simulator(model)
    else:
        path = known_model(model) if model in KNOWN_MODELS else model
        simulator = load_simulator(path, external_force=external_force)
    if not is_factory(model) and isinstance(simulator, MujocoSimulator) and dt is not None:
        simulator = _at_step(simulator, dt, external_force)
    _check(simulator, dt, model)
    return simulator


def _check(simulator: Simulator, dt: float | None, name: str) -> None:
    """Check that recordings at a time step can drive a simulator."""
    if dt is not None and abs(dt - simulator.dt) > _SAME * simulator.dt:
        raise ConfigurationError(
            f"`{name}` steps by {simulator.dt:.6g} s, and --dt asks for {dt:.6g} s. Leave --dt out, or make the "
            "simulator at that step."
        )
    inner = [state for state in simulator.state_space.names if state.startswith("act.")]
    if inner:
        raise ConfigurationError(
            f"`{name}` has actuators with inner states ({', '.join(inner)}), which recordings do not hold. Use "
            "actuators without dynamics (dyntype none)."
        )
    names = (*simulator.state_space.names, *simulator.action_space.names)
    strange = [name for name in names if not name.startswith(("qpos.", "qvel.", "ctrl.", "qfrc."))]
    if strange:
        raise ConfigurationError(
            f"`{name}` names its states and actions {', '.join(names)}; recordings want qpos.<joint>, qvel.<joint>, "
            f"ctrl.<actuator> or qfrc.<joint>. Rename {', '.join(strange)}."
        )


def _at_step(simulator: MujocoSimulator, dt: float, external_force: bool) -> MujocoSimulator:
    if not (math.isfinite(dt) and dt > 0):
        raise ConfigurationError(f"--dt: wanted a time step > 0 s, found {dt}.")
    model = load_model(simulator.model)
    frame_skip = max(1, math.ceil(dt / model.opt.timestep * (1 - _SAME)))
    model.opt.timestep = dt / frame_skip
    return MujocoSimulator(model, frame_skip=frame_skip, external_force=external_force)
