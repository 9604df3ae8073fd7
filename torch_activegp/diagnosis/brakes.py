"""How far the initial states of each segment go of the step that a fit wants: some must go slower than the rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.elimination import Eliminated
from torch_activegp.diagnosis.runs import Array

_SHORTER, _STOPPED = 0.3, 0.02
_HALTED = 0.05
_NOTHING = 1e-5


class Brakes:
    """A share of the step for each of S segments, all of it in the beginning.

    Args:
        size: number of segments S.
    """

    def __init__(self, size: int) -> None:
        self.share: Array = np.ones(size)

    @property
    def on(self) -> NDArray[np.bool_]:
        """Which are braked, ``(S,)``."""
        return self.share < 1.0

    def moving(self, linear: Eliminated, chi2: Array) -> NDArray[np.bool_]:
        """Which have anything to gain by their next step, ``(S,)``; where none has, all count as moving.

        Args:
            linear: what the steps promise.
            chi2: of each, ``(S,)``.
        """
        some = linear.promised(self.share) > _NOTHING * np.median(chi2)
        return some if some.any() else np.ones_like(some)

    def blame(self, worse: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
        """Brakes those that got worse and were not stopped before, where these are less than half of all.

        Returns:
            Those that were braked, ``(S,)``; None where there were none, or too many.
        """
        bad = worse & (self.share > _STOPPED)
        if not 0 < bad.sum() < 0.5 * len(bad):
            return None
        self.share[bad] *= _SHORTER
        return bad

    def follow(self, better: NDArray[np.bool_], tried: NDArray[np.bool_]) -> bool:
        """Releases those that got better, and brakes the others that were tried; whether all these hardly move now."""
        self.share = np.where(better, np.minimum(2.0 * self.share, 1.0), np.where(tried, _SHORTER, 1.0) * self.share)
        return bool((self.share[tried & ~better] < _HALTED).all())
