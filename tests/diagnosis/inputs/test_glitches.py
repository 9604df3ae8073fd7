from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.glitches import Glitches, bridged, glitches, in_words

TIME = np.arange(200) * 0.01
NOISE = np.array([1e-3, 1e-3])


@pytest.fixture
def position() -> np.ndarray:
    noise = np.random.default_rng(0).normal(size=(200, 2)) * NOISE
    return np.stack([np.sin(5 * TIME), TIME**2], axis=1) + noise


def test_each_channel_has_its_own(position: np.ndarray) -> None:
    position[40, 0] += 0.2
    position[[90, 91], 1] = 0.0
    found = glitches(TIME, position, NOISE)
    assert found.kept.tolist() == [0.0, 0.0]
    assert np.argwhere(found.lost).tolist() == [[40, 0], [90, 1], [91, 1]]


def test_what_comes_again_and_again_is_none(position: np.ndarray) -> None:
    position[5:195:18, 0] += 0.2
    found = glitches(TIME, position, NOISE)
    assert found.lost.sum() == 0
    assert found.kept.tolist() == [pytest.approx(11 / 200), 0.0]
    position[5:75:18, 0] -= 0.2
    assert glitches(TIME, position, NOISE).lost[:, 0].sum() == 7


def test_a_line_bridges_them(position: np.ndarray) -> None:
    lost = np.zeros((200, 2), dtype=bool)
    lost[[40, 41], 0] = lost[0, 1] = True
    whole = bridged(TIME, position, lost)
    np.testing.assert_allclose(np.diff(whole[39:43, 0], 2), 0.0, atol=1e-12)
    assert whole[0, 1] == position[1, 1]
    np.testing.assert_array_equal(whole[~lost], position[~lost])


def test_words_say_where_and_how_many() -> None:
    lost = np.zeros((200, 2), dtype=bool)
    none = np.zeros(2)
    assert in_words(TIME, Glitches(lost, none), ["hip", "knee"]) == ()
    lost[[40, 41], 0] = lost[123, 1] = True
    assert in_words(TIME, Glitches(lost, none), ["hip", "knee"]) == (
        "2 rows left out, the first at 0.4 s: qpos.hip is far from where the rows around it put it.",
        "a row left out, at 1.23 s: qpos.knee is far from where the rows around it put it.",
    )
    (text,) = in_words(TIME, Glitches(np.zeros_like(lost), np.array([0.0, 0.06])), ["hip", "knee"])
    assert text.startswith("6 % of the rows of qpos.knee are far from where")
