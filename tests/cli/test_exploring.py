from __future__ import annotations

import pytest

from torch_activegp.cli.exploring import parse_bounds
from torch_activegp.errors import ConfigurationError


def test_bounds_are_read() -> None:
    assert parse_bounds(None) == {}
    words = ["qvel=-5:5", "qpos.hip = 0.5 : 1e3"]
    assert parse_bounds(words) == {"qvel": (-5.0, 5.0), "qpos.hip": (0.5, 1000.0)}


@pytest.mark.parametrize(
    "word", ["qvel", "qvel=", "qvel=5", "qvel=a:b", "qvel=5:5", "qvel=5:-5", "=1:2", "x=0:inf", "x=nan:1", "x=1:2:3"]
)
def test_bad_bounds_are_shown(word: str) -> None:
    with pytest.raises(ConfigurationError, match=f"wanted NAME=LOW:HIGH.* found {word!r}"):
        parse_bounds([word])
