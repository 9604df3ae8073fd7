"""Angles that were recorded on the circle, as angles on the line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from torch_activegp.data.recording import Recording


def unwrap_angles(recording: Recording, joints: Sequence[str]) -> Recording:
    """Take the leaps of a turn out of recorded angles, so that they can be differentiated and interpolated.

    Args:
        recording: one run.
        joints: the joints that turn, in rad; between two rows they turn by less than half a turn.

    Returns:
        The recording with angles that go beyond a turn where the joint does.

    Raises:
        DataError: if the position of such a joint was not recorded.

    >>> columns = {"time": [0.0, 0.1, 0.2, 0.3], "qpos.wheel": [3.0, -3.2, -3.1, -3.0]}
    >>> unwrap_angles(Recording.from_columns("spin", columns), ["wheel"])["qpos.wheel"].round(decimals=2).tolist()
    [3.0, 3.08, 3.18, 3.28]
    """
    names = [f"qpos.{joint}" for joint in joints]
    return recording.replace({name: torch.from_numpy(np.unwrap(recording[name].numpy())) for name in names})
