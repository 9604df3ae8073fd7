"""Cogging: the pull of a motor's magnets, one sine or several of the position."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self

import mujoco
import numpy as np
from scipy import ndimage, signal

from torch_activegp.physics.effect import Array, Effect, Parameter
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.place import Place

_SMALL = 0.05
_PERIODS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 24, 36, 48, 72, 96)
"""Few of many: the others show in a :meth:`Cogging.scan`."""
ENDINGS = ("", "_2", "_3")
"""Of the names of each wave's parameters. Three waves: a motor's poles, its slots, and what both have in common."""

_SEEN_ONCE, _SEEN_TO_REPEAT = 0.8, 3.0
"""So much of a period lies in the range, else it is a spring: 0.6 of one fitted a spring behind filtered noise better
than a spring did. And so many periods of each wave where there are several: any bump is a sum of slower waves."""
_FINENESS = 8
"""Bins of the position in the shortest period."""
_MOST_BINS = 1 << 18
"""A range of more turns than this has room for is left to the list of numbers."""
_PADDING = 4
_TREND = 9
"""Resolved numbers of periods over which the median is the trend."""
_PEAKS = 6
"""Of each kind. The pull weighs slow waves most: one of 28 periods a turn under a paddle was the fifth."""
_WHOLE = 1e-3


@dataclasses.dataclass(frozen=True, eq=False)
class Cogging(JointEffect):
    """A sin(N q + phase), or a sum of such waves of several N: :attr:`more` has one wave more.

    The parameters are the amplitudes of the sine and the cosine of each wave about the middle of the recorded range, so
    that amplitudes and numbers of periods hardly depend on each other; then the number of periods of each.

    Args:
        center: the middle of the recorded range, rad or m.
        width: of that.
    """

    name = "cogging"
    never_negative = frozenset(f"amplitude{end}" for end in ENDINGS)
    law = "A sin(N q + phase)"
    center: float = 0.0
    width: float = 0.0

    @property
    def range(self) -> tuple[float, float]:
        """That of the recorded positions, rad or m."""
        return self.center - 0.5 * self.width, self.center + 0.5 * self.width

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint, with the numbers of periods that its range and speed let us see."""
        scale = _SMALL * place.force
        width = max(place.position[1] - place.position[0], 1e-9)
        fastest = 0.6 * np.pi / (max(place.top_speed, 1e-9) * place.dt)
        turns = place.position_unit == "rad"
        least = max(1.0 if turns else 0.0, _SEEN_ONCE * 2 * np.pi / width)
        if turns:
            periods = [float(n) for n in _PERIODS if n >= least and n < 4 * fastest]
            periods = periods or [2 * np.pi * n / width for n in (1, 2, 3)]
        else:
            periods = [2 * np.pi * n / width for n in (2, 3, 4, 6, 8, 11, 16, 22, 32)]
        unit = "1/turn" if turns else f"rad/{place.position_unit}"
        sine, cosine = (Parameter(name, place.force_unit, scale) for name in ("sine", "cosine"))
        made: Self | None = None
        for waves in range(len(ENDINGS), 0, -1):
            low = least if waves == 1 else max(least, _SEEN_TO_REPEAT * 2 * np.pi / width)
            quarter = 0.5 * np.pi / width
            count = Parameter("periods", unit, quarter, low=low, place=True)
            parameters = (*_numbered((sine, cosine), waves), *_numbered((count,), waves))
            seeds = [[scale, scale, n] for n in periods] if waves == 1 else [[scale] * 2 * waves + periods[:1] * waves]
            several = {"variant": f"{waves} waves", "stands_in": True} if waves > 1 else {}
            about = {"center": float(np.mean(place.position)), "width": width}
            made = cls.make(place, parameters, seeds, linear=2 * waves, more=made, **about, **several)
        assert made is not None
        return made

    def plausible(self, values: Array) -> bool:
        """Whether the range tells the waves apart: two of nearly the same number make a bump in one place."""
        resolved = 4.0 * self.parameters[-1].scale
        return bool((np.diff(np.sort(values[self.linear :])) >= resolved).all())

    def once_more(self, values: Array, added: Array) -> tuple[Effect, Array] | None:
        """Amplitudes, then periods; see :meth:`Effect.once_more`."""
        if self.more is None:
            return None
        return self.more, np.concatenate([values[: self.linear], added[:2], values[self.linear :], added[2:]])

    def once_less(self, values: Array) -> list[Array]:
        """Without each wave; see :meth:`Effect.once_less`."""
        waves = self.linear // 2
        return [np.delete(values, [2 * w, 2 * w + 1, self.linear + w]) for w in range(waves) if waves > 1]

    def scan(self, position: Array, pull: Array) -> Array:
        """The numbers of periods where the pull has the highest peaks over the position, as it is and above its trend.

        A wave that fits no whole number of times into the range is seen at its own number alone, so that no list of
        numbers finds it. See :meth:`Effect.scan`.
        """
        first, seed = self.linear, self.seeds[0]
        width = float(np.ptp(position)) if len(position) else 0.0
        bins = int(_FINENESS * max(float(self.seeds[:, first].max()), self.parameters[first].low) * width / (2 * np.pi))
        if width <= 0.0 or not _FINENESS <= bins <= _MOST_BINS:
            return super().scan(position, pull)
        total, _ = np.histogram(position, bins, weights=pull)
        power = np.abs(np.fft.rfft(total, _PADDING * bins)) ** 2
        periods = 2 * np.pi * np.arange(len(power)) / (width * _PADDING)
        trend = ndimage.median_filter(power, _TREND * _PADDING)
        inside = (periods >= self.parameters[first].low) & (periods < periods[-1] / 2)
        found: list[float] = []
        for height in (power, power / np.maximum(trend, 1e-300)):
            peaks = signal.find_peaks(height)[0]
            peaks = peaks[inside[peaks]]
            found += [float(periods[p]) for p in peaks[np.argsort(-height[peaks], kind="stable")][:_PEAKS]]
        return np.array([[*seed[:first], n] for n in dict.fromkeys(found)]).reshape(-1, len(seed))

    def starts_beside(self, values: Array) -> list[Array]:
        """The same with the whole numbers of periods a turn on both sides.

        A motor has no other that drives its joint directly. Waves that differ by one over the range look alike, so that
        a fit may end at another number: at 22.8 for 23.
        """
        first = self.linear
        if first > 2 or self.parameters[first].unit != "1/turn":
            return []
        near = np.unique([np.floor(values[first]), np.ceil(values[first])])
        whole = near[(near >= self.parameters[first].low) & (np.abs(near - values[first]) > _WHOLE)]
        return [np.array([*values[:first], periods]) for periods in whole]

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        total = np.zeros(())
        for wave in range(self.linear // 2):
            angle = values[self.linear + wave] * (position - self.center)
            total = total + values[2 * wave] * np.sin(angle) + values[2 * wave + 1] * np.cos(angle)
        return total

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes passive DC motors with cogging, one for each wave."""
        law = self.describe(values)
        for end in ENDINGS[: self.linear // 2]:
            self.add_passive(spec, cogging=[law[f"amplitude{end}"], law[f"periods{end}"], law[f"phase{end}"]])
        return True

    def describe(self, values: Array) -> dict[str, float]:
        """Amplitude, number of periods and phase at zero; of the second largest wave ``amplitude_2`` and so on."""
        law = {}
        amplitudes = np.hypot(values[: self.linear : 2], values[1 : self.linear : 2])
        for end, wave in zip(ENDINGS, np.argsort(-amplitudes, kind="stable"), strict=False):
            sine, cosine, periods = values[2 * wave], values[2 * wave + 1], values[self.linear + wave]
            phase = np.arctan2(cosine, sine) - periods * self.center
            law[f"amplitude{end}"] = float(amplitudes[wave])
            law[f"periods{end}"] = float(periods)
            law[f"phase{end}"] = float(np.arctan2(np.sin(phase), np.cos(phase)))
        return law


def _numbered(parameters: Sequence[Parameter], waves: int) -> list[Parameter]:
    """The parameters of each wave in turn."""
    return [dataclasses.replace(p, name=p.name + end) for end in ENDINGS[:waves] for p in parameters]
