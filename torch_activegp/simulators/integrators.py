"""One step of an ordinary differential equation, with the action held: Runge-Kutta 4 and semi-implicit Euler."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from torch_activegp.errors import ShapeError

Dynamics = Callable[[Tensor, Tensor], Tensor]
"""``(state (..., d), action (..., m)) -> d state / dt (..., d)``."""

Integrator = Callable[[Dynamics, Tensor, Tensor, float], Tensor]
"""``(dynamics, state, action, dt) -> state after dt``."""


def rk4(dynamics: Dynamics, state: Tensor, action: Tensor, dt: float) -> Tensor:
    """Classical Runge-Kutta: four evaluations, local error of order ``dt**5``.

    Args:
        dynamics: ``(state, action) -> d state / dt``.
        state: ``(..., d)``.
        action: ``(..., m)``, held during the step.
        dt: length of the step, s.

    Returns:
        State after ``dt``, ``(..., d)``.
    """
    k1 = dynamics(state, action)
    k2 = dynamics(torch.add(state, k1, alpha=0.5 * dt), action)
    k3 = dynamics(torch.add(state, k2, alpha=0.5 * dt), action)
    k4 = dynamics(torch.add(state, k3, alpha=dt), action)
    return torch.add(state, k1 + 2.0 * (k2 + k3) + k4, alpha=dt / 6.0)


def semi_implicit_euler(dynamics: Dynamics, state: Tensor, action: Tensor, dt: float) -> Tensor:
    """Symplectic Euler: the velocity first, then the position with the new velocity; local error ``dt**2``.

    Args:
        dynamics: ``(state, action) -> d state / dt``; only its second half, the acceleration, is used.
        state: ``(..., d)``, positions q in the first half, their rates v = dq/dt in the second.
        action: ``(..., m)``, held during the step.
        dt: length of the step, s.

    Returns:
        State after ``dt``, ``(..., d)``.

    Raises:
        ShapeError: d is odd, so that the state cannot be positions and their rates.
    """
    half, odd = divmod(state.shape[-1], 2)
    if odd:
        raise ShapeError(
            f"semi_implicit_euler: wanted a state of positions and then as many velocities, found {state.shape[-1]} "
            "dimensions. Use rk4 for other states."
        )
    acceleration = dynamics(state, action)[..., half:]
    velocity = torch.add(state[..., half:], acceleration, alpha=dt)
    position = torch.add(state[..., :half], velocity, alpha=dt)
    return torch.cat((position, velocity), dim=-1)
