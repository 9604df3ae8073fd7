"""How far a fit trusts its derivatives by the parameters: the damping of Levenberg and Marquardt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.elimination import Eliminated, bounded_step
from torch_activegp.diagnosis.shooting.fit import bounds, difference_steps
from torch_activegp.physics.effect import Effect

_FIRST, _LEAST, _SHORT = 1e-6, 1e-9, 0.5
_FACTOR = 10.0
_MOST, _HOPEFUL_MOST = 10.0, 1e3


class Trust:
    """The damping for the parameters of some effects.

    Args:
        effects: of the set.

    Attributes:
        untold: whether nothing speaks against what steps promise: none helped or was refused yet, or the last one
            helped much.
    """

    def __init__(self, effects: Sequence[Effect]) -> None:
        self._effects, self._damping, self.untold = effects, _FIRST, True
        self._low, self._high = bounds(effects)

    def begin(self) -> None:
        """As at first."""
        self._damping, self.untold = _FIRST, True

    def inside(self, flat: Array) -> Array:
        """Parameters ``(P,)`` within their bounds."""
        return np.clip(flat, self._low, self._high)

    def lengthen(self, much: bool) -> None:
        """After a step that helped, maybe much."""
        self._damping, self.untold = max(self._damping / _FACTOR, _LEAST), much

    def shorten(self, hopeful: bool) -> bool:
        """After one that did not; whether the next one would be too short.

        Args:
            hopeful: whether it promised much.
        """
        self._damping, self.untold = max(_FACTOR * self._damping, _SHORT), False
        return self._damping > (_HOPEFUL_MOST if hopeful else _MOST)

    def step(self, linear: Eliminated, flat: Array) -> Array:
        """The next step of the parameters ``(P,)``."""
        normal, gradient = linear.normal.sum(0), linear.gradient.sum(0)
        little = difference_steps(self._effects, flat)
        return bounded_step(normal, gradient, self._damping, flat, self._low, self._high, little)
