from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from torch_activegp.physics.sensing import MAX_DELAY, SENSING, SensorBias, SensorDelay, SensorGain

TIME = np.linspace(0.0, 1.0, 21)


def read(channel: int, delay: np.ndarray) -> np.ndarray:
    """Two cases of one segment ``(2, 1, 21)`` of channel c: t + c, late."""
    return np.asarray(TIME[None, None] + channel - np.ravel(delay)[:, None, None])


@pytest.mark.parametrize(
    ("kind", "values", "wanted"),
    [
        (SensorBias, [0.1, -0.2], [TIME + 1.1, TIME + 0.8]),
        (SensorGain, [0.1, -0.2], [1.1 * (TIME + 1), 0.8 * (TIME + 1)]),
        (SensorDelay, [0.03, 0.0], [TIME + 0.97, TIME + 1]),
    ],
)
def test_a_sensor_changes_its_own_channel(bench: Any, kind: Any, values: Any, wanted: Any) -> None:
    effect = kind.at(bench.elbow, bench.model)
    assert effect.target == "sensor:elbow"
    channel, changed = effect.measure(read, np.array(values)[:, None, None])
    assert channel == 1
    np.testing.assert_allclose(changed[:, 0], wanted)


def test_zero_is_no_effect_and_no_file_holds_a_sensor(bench: Any) -> None:
    for kind in SENSING:
        effect = kind.at(bench.elbow, bench.model)
        _, changed = effect.measure(read, np.zeros((2, 1, 1)))
        np.testing.assert_array_equal(changed, read(1, np.zeros(2)))
        assert not effect.write(bench.spec, np.array([0.1]))


def test_words_and_bounds(bench: Any) -> None:
    assert SensorGain.at(bench.elbow, bench.model).describe(np.array([0.02])) == {"gain": 1.02}
    assert SensorDelay.at(bench.elbow, bench.model).parameters[0].high == MAX_DELAY
    assert SensorBias.at(bench.elbow, bench.model).parameters[0].unit == "rad"
