from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis import lengths
from torch_activegp.diagnosis.lengths import longest, uncut
from torch_activegp.diagnosis.numerics import Numerics


@pytest.fixture
def forms(bench):
    return Numerics.of(bench.machine, 1)


def test_segments_that_cannot_be_shorter_end_the_search(bench, forms, monkeypatch) -> None:
    monkeypatch.setattr(lengths, "_SHORTEST", 0.0)
    found = longest(bench.machine, forms, bench.shooting.noise, -1.0)
    assert (found.segments.scored[:, 1] - found.segments.scored[:, 0]).max() < 24
    assert len(found.nominal.per_segment) == found.segments.size
    assert found.halved


def test_segments_are_not_halved_where_the_nominal_follows(bench, forms) -> None:
    found = longest(bench.machine, forms, bench.shooting.noise, 1e9)
    assert found.segments.size == uncut(bench.machine).size
    assert found.nominal is found.uncut
    assert not found.halved


def test_another_bar_halves_others_and_does_not_fit_the_longest_again(bench, forms, monkeypatch) -> None:
    noise = bench.shooting.noise
    near = longest(bench.machine, forms, noise, 1.0)
    assert near.halved
    sizes: list[int] = []
    fit = lengths._nominal
    monkeypatch.setattr(lengths, "_nominal", lambda shooting: sizes.append(shooting.segments.size) or fit(shooting))
    again = longest(bench.machine, forms, noise, 1.0, near)
    assert uncut(bench.machine).size not in sizes
    assert again.segments.size == near.segments.size
    np.testing.assert_array_equal(again.nominal.per_segment, near.nominal.per_segment)
    sizes.clear()
    assert not longest(bench.machine, forms, noise, 1e9, near).halved
    assert not sizes
