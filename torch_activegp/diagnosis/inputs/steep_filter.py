"""A low-pass filter that positions went through after they were recorded."""

from __future__ import annotations

from typing import NamedTuple


class SteepFilter(NamedTuple):
    """It has passed the noise of a channel, whose spectrum is level up to a corner.

    Args:
        corner: of the filter, in parts of the sampling rate.
        scale: standard deviation of the noise, rad or m.
        order: of the filter, and how often it was run.
    """

    corner: float
    scale: float
    order: tuple[int, int] = (2, 1)

    @property
    def rows(self) -> int:
        """Rows from one value to the next that is new: the noise in between follows from those around."""
        return max(int(0.5 / self.corner), 1)
