"""Torques on a pendulum that act only in a part of its space: what a simulator may lack.

Each is a module ``(theta (...) [rad], theta_dot (...) [rad/s]) -> torque (...) [N m]`` for
``Pendulum(extra_torque=...)``.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.parameters import register_value
from torch_activegp.simulators.space import wrap_angle


class LocalBrake(nn.Module):
    """A brake that works near one angle: torque = -damping exp(-(d / width)^2 / 2) theta_dot.

    d is the distance from ``center`` on the circle.

    Args:
        center: angle where the brake is strongest, rad.
        width: standard deviation of the Gaussian window, rad.
        damping: damping at the center, N m s/rad.
        trainable: make the three parameters instead of buffers.

    Raises:
        ConfigurationError: ``width`` is not positive.
    """

    center: Tensor
    width: Tensor
    damping: Tensor

    def __init__(
        self, center: float = 1.2, width: float = 0.25, damping: float = 1.0, *, trainable: bool = False
    ) -> None:
        super().__init__()
        _require_width(width)
        for name, value in (("center", center), ("width", width), ("damping", damping)):
            register_value(self, name, value, trainable)

    def forward(self, theta: Tensor, theta_dot: Tensor) -> Tensor:
        """Torque of the brake, N m; ``(...)`` from angles ``(...)`` in rad and speeds ``(...)`` in rad/s."""
        offset = wrap_angle(theta - self.center) / self.width
        return -self.damping * torch.exp(-0.5 * offset * offset) * theta_dot


class Magnet(nn.Module):
    """A magnet that pulls towards one angle: torque = -strength (d / width) exp((1 - (d / width)^2) / 2).

    d is the signed distance from ``center`` on the circle; the pull is strongest, and equals ``strength``, one
    ``width`` away from it.

    Args:
        center: angle of the magnet, rad.
        width: distance of the strongest pull, rad.
        strength: strongest pull, N m; a negative one pushes away.
        trainable: make the three parameters instead of buffers.

    Raises:
        ConfigurationError: ``width`` is not positive.
    """

    center: Tensor
    width: Tensor
    strength: Tensor

    def __init__(
        self, center: float = 1.2, width: float = 0.25, strength: float = 1.0, *, trainable: bool = False
    ) -> None:
        super().__init__()
        _require_width(width)
        for name, value in (("center", center), ("width", width), ("strength", strength)):
            register_value(self, name, value, trainable)

    def forward(self, theta: Tensor, theta_dot: Tensor) -> Tensor:
        """Torque of the magnet, N m; ``(...)`` from angles ``(...)`` in rad. The speed has no influence."""
        offset = wrap_angle(theta - self.center) / self.width
        return -self.strength * offset * torch.exp(0.5 - 0.5 * offset * offset)


class JointStop(nn.Module):
    """A soft one-sided stop past a position: torque = -stiffness d - damping theta_dot min(d / depth, 1), for d > 0.

    d is how far the angle is past the stop; the damper acts only on the way in, and fully from ``depth`` on.

    Args:
        position: angle of the stop, rad.
        stiffness: N m/rad.
        damping: N m s/rad.
        depth: where the damper acts fully, rad.
        trainable: make position, stiffness and damping parameters instead of buffers.

    Raises:
        ConfigurationError: ``depth`` is not positive.
    """

    position: Tensor
    stiffness: Tensor
    damping: Tensor

    def __init__(
        self,
        position: float = 2.4,
        stiffness: float = 8.0,
        damping: float = 1.0,
        *,
        depth: float = 0.1,
        trainable: bool = False,
    ) -> None:
        super().__init__()
        _require_width(depth, "depth")
        self.depth = depth
        for name, value in (("position", position), ("stiffness", stiffness), ("damping", damping)):
            register_value(self, name, value, trainable)

    def forward(self, theta: Tensor, theta_dot: Tensor) -> Tensor:
        """Torque of the stop, N m; ``(...)`` from angles ``(...)`` in rad and speeds ``(...)`` in rad/s."""
        past = (theta - self.position).clamp_min(0.0)
        damper = self.damping * theta_dot.clamp_min(0.0) * (past / self.depth).clamp_max(1.0)
        return -self.stiffness * past - damper


def _require_width(width: float, name: str = "width") -> None:
    if not width > 0:
        raise ConfigurationError(f"wanted `{name}` > 0 rad, found {width}.")
