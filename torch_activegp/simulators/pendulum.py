"""The pendulum, with the equation as printed in the paper and with Gymnasium's."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import torch
from torch import Tensor

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.base import Simulator
from torch_activegp.simulators.integrators import Integrator, semi_implicit_euler
from torch_activegp.simulators.parameters import register_value
from torch_activegp.simulators.space import ActionSpace, StateSpace

MAX_SPEED = 8.0
"""Limit of the angular velocity, rad/s."""
MAX_TORQUE = 2.0
"""Limit of the torque, N m."""

Torque = Callable[[Tensor, Tensor], Tensor]
"""``(theta (...) [rad], theta_dot (...) [rad/s]) -> torque (...) [N m]``; an ``nn.Module`` or a function."""


class Pendulum(Simulator):
    """A rod on a motor; state (theta [rad], theta_dot [rad/s]), action (torque [N m]).

    ``equation="paper"``: m l^2 theta'' + 3 m g l sin(theta) = 3 u, theta = 0 hangs. ``equation="gymnasium"``:
    theta'' = 3 g / (2 l) sin(theta) + 3 u / (m l^2), theta = 0 stands. The torque is clipped to [-2, 2] N m, the
    speed to [-8, 8] rad/s after each step. With the default integrator, semi-implicit Euler, the position moves with
    the new, clipped speed, as in Gymnasium's ``Pendulum-v1``; only the angle is wrapped.

    Args:
        g: gravity, m/s^2; a number, a tensor that broadcasts with the batch, or an ``nn.Parameter``.
        m: mass, kg; like ``g``.
        l: length, m; like ``g``.
        equation: ``"paper"`` or ``"gymnasium"``.
        dt: time step, s.
        integrator: `semi_implicit_euler` or `rk4`.
        trainable: make g, m and l parameters instead of buffers. One given as ``nn.Parameter`` always is one.
        extra_torque: a torque on the joint that depends on the state, N m; see `LocalBrake` and `Magnet`.

    Raises:
        ConfigurationError: an unknown equation, or m or l not positive.

    Example:
        >>> pendulum = Pendulum(g=9.0, m=0.5, l=2.0)
        >>> next_state = pendulum(torch.zeros(50, 2), torch.ones(50, 1))
        >>> next_state.shape, round(next_state[0, 1].item(), 6)
        (torch.Size([50, 2]), 0.075)

    Reference: Miller, Thorpe, Topcu 2024, arXiv 2403.17233, section on the pendulum.
    """

    g: Tensor
    m: Tensor
    l: Tensor  # noqa: E741 - the paper's name

    def __init__(
        self,
        g: float | Tensor = 9.81,
        m: float | Tensor = 1.0,
        l: float | Tensor = 1.0,  # noqa: E741 - the paper's name
        equation: Literal["paper", "gymnasium"] = "paper",
        dt: float = 0.05,
        integrator: Integrator = semi_implicit_euler,
        trainable: bool = False,
        extra_torque: Torque | None = None,
    ) -> None:
        high = [math.pi, MAX_SPEED]
        super().__init__(
            StateSpace(["theta", "theta_dot"], [-high[0], -high[1]], high, angles=[0]),
            ActionSpace(["torque"], -MAX_TORQUE, MAX_TORQUE),
            dt,
        )
        if equation not in ("paper", "gymnasium"):
            raise ConfigurationError(f'Pendulum: wanted equation "paper" or "gymnasium", found {equation!r}.')
        for name, value, positive in (("g", g, False), ("m", m, True), ("l", l, True)):
            register_value(self, name, value, trainable)
            if positive and not bool((getattr(self, name) > 0).all()):
                raise ConfigurationError(f"Pendulum: wanted `{name}` > 0, found {value}.")
        self.equation = equation
        self.integrator = integrator
        self.extra_torque = extra_torque
        self._weight = -1.0 if equation == "paper" else 0.5

    def acceleration(self, theta: Tensor, theta_dot: Tensor, torque: Tensor) -> Tensor:
        """Angular acceleration; all arguments and the result ``(...)``, rad, rad/s, N m, rad/s^2."""
        return 3.0 * self._third_of_acceleration(theta, theta_dot, torque)

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advances states ``(..., 2)`` by ``dt`` under torques ``(..., 1)``; see `Simulator.step`."""
        torque = action.select(-1, 0).clamp(-MAX_TORQUE, MAX_TORQUE)
        theta, theta_dot = state.unbind(-1)
        if self.integrator is semi_implicit_euler:
            third = self._third_of_acceleration(theta, theta_dot, torque)
            theta_dot = torch.add(theta_dot, third, alpha=3.0 * self.dt).clamp(-MAX_SPEED, MAX_SPEED)
            theta = torch.add(theta, theta_dot, alpha=self.dt)
        else:
            theta, theta_dot = self.integrator(self._derivative, state, torque, self.dt).unbind(-1)
            theta_dot = theta_dot.clamp(-MAX_SPEED, MAX_SPEED)
        return self.state_space.wrap(torch.stack((theta, theta_dot), dim=-1)).to(state.dtype)

    def _third_of_acceleration(self, theta: Tensor, theta_dot: Tensor, torque: Tensor) -> Tensor:
        # The step is the inner loop of planners: this form has the fewest tensor operations.
        if self.extra_torque is not None:
            torque = torque + self.extra_torque(theta, theta_dot)
        length = self.l
        return torch.addcmul(torque / (self.m * length), torch.sin(theta), self.g, value=self._weight) / length

    def _derivative(self, state: Tensor, torque: Tensor) -> Tensor:
        theta, theta_dot = state.unbind(-1)
        acceleration = self.acceleration(theta, theta_dot, torque)
        return torch.stack(torch.broadcast_tensors(theta_dot, acceleration), dim=-1)
