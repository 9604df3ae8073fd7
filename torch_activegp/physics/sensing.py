"""What happens between the joint and the recording: bias, gain and delay of a position sensor."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Effect, Parameter
from torch_activegp.physics.place import Place

MAX_DELAY = 0.1
"""Longest sensor delay that is tried, s."""


@dataclasses.dataclass(frozen=True, eq=False)
class SensorEffect(Effect):
    """Base of the effects on a recorded position.

    Args:
        channel: which recorded position.
    """

    channel: int = 0

    @classmethod
    def make(cls, place: Place, parameter: Parameter, seeds: list[float], linear: int) -> Self:
        """Makes the effect for a recorded position."""
        return cls(f"sensor:{place.item}", (parameter,), np.array(seeds)[:, None], linear=linear, channel=place.index)

    @property
    def acts_on(self) -> str:
        """The joint whose position it reads."""
        return f"joint:{self.item}"


class SensorBias(SensorEffect):
    """q + b: the encoder's zero is off."""

    name = "sensor_bias"
    law = "q + b"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a recorded position."""
        scale = 0.02 * (place.position[1] - place.position[0])
        return cls.make(place, Parameter("bias", place.position_unit, scale), [scale], 1)

    def measure(self, read: Callable[[int, Array], Array], values: Array) -> tuple[int, Array]:
        """Adds the bias."""
        return self.channel, read(self.channel, np.zeros(len(values))) + values[:, :1]


class SensorGain(SensorEffect):
    """g q: the encoder's scale is off."""

    name = "sensor_gain"
    law = "g q"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a recorded position."""
        return cls.make(place, Parameter("excess", "1", 0.02, low=-0.9, high=9.0), [0.02], 1)

    def measure(self, read: Callable[[int, Array], Array], values: Array) -> tuple[int, Array]:
        """Scales the position."""
        return self.channel, read(self.channel, np.zeros(len(values))) * (1.0 + values[:, :1])

    def describe(self, values: Array) -> dict[str, float]:
        """The gain, 1 for the recording as it is."""
        return {"gain": 1.0 + float(values[0])}


class SensorDelay(SensorEffect):
    """q(t - T): the recording is late."""

    name = "sensor_delay"
    never_negative = frozenset({"seconds"})
    law = "q(t - T)"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a recorded position."""
        seeds = [float(seed) for seed in np.geomspace(np.clip(place.dt / 2, 1e-3, 0.5 * MAX_DELAY), 0.9 * MAX_DELAY, 5)]
        return cls.make(place, Parameter("seconds", "s", 0.3 * place.dt, low=0.0, high=MAX_DELAY), seeds, 0)

    def measure(self, read: Callable[[int, Array], Array], values: Array) -> tuple[int, Array]:
        """Reads the trajectory earlier."""
        return self.channel, read(self.channel, values[:, 0])


SENSING: tuple[type[SensorEffect], ...] = (SensorBias, SensorGain, SensorDelay)
"""The family, in the order in which a modeller would try them."""
