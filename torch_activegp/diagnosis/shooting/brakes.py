"""How far the initial states of each segment go of the step that a fit wants: some must go slower than the rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.elimination import Eliminated
from torch_activegp.diagnosis.shooting.following import SLOWER

_LEAST = 1e-3
_HALTED = 10.0
_NOTHING = 1e-5


class Brakes:
    """The damping of the states' steps for each of S segments, in units of the normal matrix's diagonal; none at first.

    Args:
        size: number of segments S.
    """

    def __init__(self, size: int) -> None:
        self.damping: Array = np.zeros(size)

    @property
    def on(self) -> NDArray[np.bool_]:
        """Which are braked, ``(S,)``."""
        return self.damping > 0.0

    def moving(self, linear: Eliminated, shift: Array, chi2: Array) -> NDArray[np.bool_]:
        """Which have anything to gain by their next step, ``(S,)``; where none has, all count as moving.

        Args:
            linear: what the steps promise.
            shift: the steps, ``(S, n)``.
            chi2: of each, ``(S,)``.
        """
        some = linear.promised(shift) > _NOTHING * np.median(chi2)
        return some if some.any() else np.ones_like(some)

    def take(self, way: NDArray[np.int64]) -> None:
        """Brakes each segment as in the way that its states take: 0 for the step as it was, then `SLOWER`, then any."""
        slower = np.array([0.0, *SLOWER, 0.0])
        self.damping = np.maximum(self.damping, slower[np.minimum(way, len(slower) - 1)])

    def follow(self, better: NDArray[np.bool_], tried: NDArray[np.bool_]) -> bool:
        """Releases those that got better, and brakes the others that were tried; whether all these hardly move now."""
        released = np.where(self.damping > _LEAST, self.damping / 30.0, 0.0)
        braked = np.where(tried, np.maximum(30.0 * self.damping, _LEAST), self.damping)
        self.damping = np.where(better, released, braked)
        return bool((self.damping[tried & ~better] > _HALTED).all())
