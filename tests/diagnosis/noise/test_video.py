from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.video import video_errors


def test_the_errors_of_a_video_last(make_plain_run) -> None:
    """Four times the level of the differences, for half a second and more."""
    run = make_plain_run(np.zeros(60))
    slow = dataclasses.replace(run, time=run.time * 100 / 15)
    assert video_errors([slow], 1e-3) is None
    colour, scale = video_errors([slow, dataclasses.replace(slow, video=True)], 1e-3)
    assert scale == pytest.approx(4e-3)
    assert colour[0] ** (0.6 * 15) == pytest.approx(np.exp(-1.0))
    assert colour[1] == 0.0
