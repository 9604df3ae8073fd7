"""The time step of a model that is learned from recordings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from torch import Tensor

from torch_activegp.data import Recording, noise_std

_SHARE_OF_MOTION = 0.2
_TIMES_NOISE = 3.0
_FEWEST_STEPS = 100
_SAME = 1e-6


def choose_step(recordings: Sequence[Recording]) -> float:
    """Choose a step over which the state changes well above noise, and still little.

    For each joint: the smallest number of rows over which the velocity changes (root mean square, without the share of
    noise) by at least a fifth of its standard deviation and three times its noise. The fastest joint decides. A
    shorter step would drown the simulator's error in noise and add up more steps in a free run; a longer one would
    average the control over more than the machine follows. At least 100 steps are left.

    Args:
        recordings: runs with velocities; joints that do not move are passed over.

    Returns:
        A multiple of the recordings' own time step, s, with four digits.
    """
    own = max(recording.dt for recording in recordings)
    times = [rows * recording.dt for recording in recordings for rows in _rows(recording)]
    total = sum(float(recording.time[-1] - recording.time[0]) for recording in recordings)
    wanted = min([*times, total / _FEWEST_STEPS])
    return float(f"{own * max(1, math.floor(wanted / own + _SAME)):.4g}")


def _rows(recording: Recording) -> Iterator[int]:
    """The number of rows that each moving joint asks for."""
    for joint in recording.joints:
        velocity = recording[f"qvel.{joint}"]
        spread = float(velocity.std())
        if spread > _SAME * float(velocity.abs().max()):
            noise = noise_std(velocity, recording.time) if len(velocity) > 8 else 0.0
            yield _first_change(velocity, max(_SHARE_OF_MOTION * spread, _TIMES_NOISE * noise), noise)


def _first_change(signal: Tensor, wanted: float, noise: float) -> int:
    longest = max(1, len(signal) // 4)
    for rows in range(1, longest):
        change = (signal[rows:] - signal[:-rows]).square().mean() - 2.0 * noise**2
        if float(change) >= wanted**2:
            return rows
    return longest
