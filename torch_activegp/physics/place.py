"""Where an effect may act, and how large things are there."""

from __future__ import annotations

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Place:
    """A part of the machine that effects are made for, with the size of what happens there.

    Args:
        target: name as in :class:`Effect`.
        index: degree of freedom, actuator or body in the model; -1 for the world.
        position_unit: ``rad`` or ``m``.
        force_unit: ``N m`` or ``N``.
        position: range of the recorded positions, ``(low, high)``.
        speed: root mean square velocity.
        top_speed: 99th percentile of the absolute velocity.
        force: root mean square generalised force of inertia.
        control: largest absolute control.
        dt: time between samples, s.
        qpos: address of the position.
        loss: the model's own ``frictionloss`` there.
        turns_back: whether a joint turns back within a recording, by more than a fiftieth of its range.
        both_ways: whether it goes both ways, in one recording or in two.
        servo_force: largest absolute force that a servo gives by its own law, N m or N; 0 of other drives.
        noise: standard deviation of white noise of the recorded positions.
        free: beyond these positions the model touches something in all recorded poses, ``(low, high)``.
    """

    target: str
    index: int
    position_unit: str = "rad"
    force_unit: str = "N m"
    position: tuple[float, float] = (-1.0, 1.0)
    speed: float = 1.0
    top_speed: float = 2.0
    force: float = 1.0
    control: float = 1.0
    dt: float = 0.01
    qpos: int = 0
    loss: float = 0.0
    turns_back: bool = True
    both_ways: bool = True
    servo_force: float = 0.0
    noise: float = 0.0
    free: tuple[float, float] = (-math.inf, math.inf)

    @property
    def item(self) -> str:
        """The model's own name."""
        return self.target.partition(":")[2]
