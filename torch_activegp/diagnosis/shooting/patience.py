"""When a fit whose steps keep little of their promises ends."""

from __future__ import annotations

_PART, _SHARE = 0.1, 1e-3
_STEPS = 3


class Patience:
    """Counts the steps in a row that bring less than a tenth of what they promised, and a thousandth of chi2.

    Derivatives across an impact promise what no step keeps: on a machine that strikes, eleven rounds with derivatives
    anew took 17 from a chi2 of 12500 that another set left 50 below.
    """

    def __init__(self) -> None:
        self._poor = 0

    @property
    def ends(self) -> bool:
        """Whether it was too many."""
        return self._poor >= _STEPS

    def take(self, fell: float, promised: float, chi2: float) -> None:
        """Takes a step: by how much chi2 fell, what it promised, and chi2 after it."""
        self._poor = self._poor + 1 if fell < min(_PART * promised, _SHARE * chi2) else 0
