"""A low-pass filter that positions went through after they were recorded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

REACH = 3.0
"""Periods of the corner on either side, beyond which it takes next to nothing from."""
_FINE = 2048


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

    def __call__(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """What it leaves of even rows ``(K,)``, without its lag; beyond their ends they go on as before, turned."""
        order, times = self.order
        sections = signal.butter(order, 2.0 * self.corner, output="sos")
        gain = np.abs(signal.sosfreqz(sections, np.linspace(0.0, np.pi, _FINE + 1))[1]) ** times
        reach = min(int(REACH / self.corner), _FINE - 1, len(positions) - 1)
        kernel = np.roll(np.fft.irfft(gain), reach)[: 2 * reach + 1]
        around = np.pad(positions, reach, mode="reflect", reflect_type="odd")
        return np.convolve(around, kernel / kernel.sum(), "valid")
