"""EpisodeRecord: prints as one line, and survives JSON."""

from __future__ import annotations

import dataclasses
import json
import pickle

import pytest

from torch_activegp.loops import EpisodeRecord

RECORD = EpisodeRecord(
    index=3,
    num_points=30,
    max_variance=0.123456,
    discrepancy=0.5,
    seconds=1.26,
    trust=(1.0, 1.0),
    metrics={"mse": 1e-3},
)


def test_it_prints_as_one_line() -> None:
    assert str(RECORD) == "episode 3: 30 points, max variance 0.123, discrepancy 0.5, mse 0.001 (1.3 s)"


@pytest.mark.parametrize(
    ("trust", "stepped_in"), [((1.0, 1.0), False), ((1.0, 0.0), True), ((0.5, 1.0), True), ((), False)]
)
def test_it_says_when_the_guard_stepped_in(trust: tuple[float, ...], stepped_in: bool) -> None:
    record = dataclasses.replace(RECORD, trust=trust)
    assert record.guard_stepped_in is stepped_in
    assert ("guard stepped in" in str(record)) is stepped_in


def test_it_comes_back_from_json_and_pickle() -> None:
    assert EpisodeRecord.from_dict(json.loads(json.dumps(RECORD.as_dict()))) == RECORD
    assert pickle.loads(pickle.dumps(RECORD)) == RECORD


def test_it_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        RECORD.index = 4


def test_metrics_are_optional_and_not_shared() -> None:
    first, second = (EpisodeRecord(1, 1, 1.0, 0.0, 0.0, (1.0,)) for _ in range(2))
    assert first.metrics == {}
    assert first.metrics is not second.metrics
