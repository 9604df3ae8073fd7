"""The noise of recorded positions from what a fit leaves, where that is less than was thought."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.noise_floor import finest
from torch_activegp.diagnosis.noise_model import SEEN, NoiseModel, colour_scale, is_white, likeliest
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.shooting import Shooting

_LESS = 0.9
"""Noise is taken anew where its variance falls to less than this part: floors are known to a few percent."""
_FAR_LESS = 0.25
"""The same where what is left is no noise of any colour, and the closest one stands in for a while."""
_LEAST = 200
"""Fewer values of a channel say too little."""


def quieter(shooting: Shooting, fit: Fit, loudest: NoiseModel | None = None, last: bool = False) -> NoiseModel | None:
    """Level and colour of what a fit leaves, for the channels where that is clearly not what the noise model says.

    A floor without a model cannot tell a filter's noise from a fast motion: under a tight loop that moves at 10 Hz,
    recorded at 100 Hz, it was ten times too high in variance, and hid what was weak. What any model leaves bounds the
    noise from above. It is never taken to be louder than the floor: what is left may be physics. Where it is that, and
    no noise of any colour, and far less than was thought, the closest colour stands in: what was hidden shows, and the
    noise is looked at again behind it.

    Args:
        shooting: the likelihood.
        fit: the best set.
        loudest: the floor; the noise of the likelihood where that was not changed.
        last: whether nobody would look behind it again; then nothing stands in.

    Returns:
        The noise, or None where it stays as it is in all channels.
    """
    old = shooting.noise
    scale, colour = old.scale.copy(), old.colour.copy()
    floor = loudest or old
    most = floor.innovation**2
    found = False
    for channel, channel_left in enumerate(_left(shooting, fit)):
        thought, count = float(old.innovation[channel] ** 2), channel_left.count
        poles = channel_left.colour()
        new, before = channel_left.innovation(poles), channel_left.innovation(tuple(old.colour[channel])) / thought
        if is_white([*channel_left.fresh(poles)]):
            gained = count * (np.log(thought / new) + before - 1.0)
            under = channel_left.innovation(tuple(floor.colour[channel])) <= most[channel]
            fits = under and (thought < most[channel] or (before <= 1.0 and new < _LESS * thought))
            better = fits and not _LESS < new / thought < 1.0 / _LESS and gained > SEEN
        else:
            better = not last and new < _FAR_LESS * thought
        if better:
            found = True
            scale[channel], colour[channel] = np.sqrt(new) / colour_scale(poles), poles
    return NoiseModel(scale, colour) if found else None


def _left(shooting: Shooting, fit: Fit) -> list[_Left]:
    """What is left of each channel; none where too little is known of it."""
    predicted, _ = shooting.engine.predict(shooting.segments, fit.starts[None], [fit.candidate])
    offset = 0.0 if shooting.offset is None else shooting.offset
    residual, counts = shooting.segments.position - offset - predicted[0], shooting.segments.counts
    usable = np.asarray(counts[:, 2:] & counts[:, 1:-1] & counts[:, :-2])
    if usable.sum() < _LEAST or not np.isfinite(residual[counts]).all():
        return []
    least = np.minimum(shooting.noise.innovation, finest(shooting.segments.runs)) ** 2
    freed = shooting.dof / max(shooting.samples, 1)
    return [_Left(residual[..., c], usable, freed, float(each)) for c, each in enumerate(least)]


class _Left:
    """What is left of one channel.

    Args:
        series: ``(S, K + 1)``.
        usable: where a value and the two before it count, ``(S, K - 1)``.
        freed: degrees of freedom over samples.
        least: variance of what is new, at least.
    """

    def __init__(self, series: Array, usable: NDArray[np.bool_], freed: float, least: float) -> None:
        self._series, self._usable, self._freed, self._least = series, usable, freed, least

    @property
    def count(self) -> int:
        """How many values follow two others."""
        return int(self._usable.sum())

    def colour(self) -> tuple[float, float]:
        """The likeliest colour."""
        return likeliest(self.innovation, self.count)

    def fresh(self, poles: tuple[float, float]) -> Array:
        """What is new in each value, zero where it is not known, ``(S, K - 1)``."""
        fresh = self._series[:, 2:] - poles[0] * self._series[:, 1:-1] - poles[1] * self._series[:, :-2]
        return np.where(self._usable, fresh, 0.0)

    def innovation(self, poles: tuple[float, float]) -> float:
        """Variance of what is new."""
        return max(float((self.fresh(poles) ** 2).sum() / self._usable.sum()) / self._freed, self._least, 1e-300)
