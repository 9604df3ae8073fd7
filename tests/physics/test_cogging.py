from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from torch_activegp.physics.cogging import Cogging


def test_cogging_does_no_net_work_in_a_turn(bench: Any) -> None:
    cogging, values = Cogging.at(bench.shoulder, bench.model), np.array([0.3, 0.2, 7.0])
    turn = np.linspace(0.0, 2 * np.pi, 1000, endpoint=False)
    around = cogging.force(turn, 0.0 * turn, values)
    assert abs(around.mean()) < 1e-12
    assert np.abs(around).max() == pytest.approx(cogging.describe(values)["amplitude"], rel=1e-3)


def test_cogging_looks_only_for_periods_that_the_data_can_show(bench: Any) -> None:
    narrow = dataclasses.replace(bench.shoulder, position=(-0.1, 0.1))
    assert min(seed[2] for seed in Cogging.at(narrow, bench.model).seeds) > np.pi / 0.2
    assert Cogging.at(narrow, bench.model).parameters[2].low == pytest.approx(0.8 * 2 * np.pi / 0.2)  # slower: a spring
    assert Cogging.at(dataclasses.replace(bench.shoulder, position=(-3.0, 3.0)), bench.model).parameters[2].low == 1.0
    slide = dataclasses.replace(bench.shoulder, position_unit="m", force_unit="N")
    effect = Cogging.at(slide, bench.model)
    assert [p.unit for p in effect.parameters] == ["N", "N", "rad/m"]


def test_its_description_is_amplitude_and_phase(bench: Any) -> None:
    effect, values = Cogging.at(bench.shoulder, bench.model), np.array([0.3, 0.4, 7.0])
    law, there = effect.describe(values), np.linspace(-1.0, 2.0, 9)
    assert law["amplitude"] == pytest.approx(0.5)
    assert 0.5 * np.sin(7.0 * there + law["phase"]) == pytest.approx(effect.force(there, there, values))
    assert effect.force(np.array(effect.center), np.zeros(()), values) == pytest.approx(0.4)


def test_more_waves_are_one_law(bench: Any) -> None:
    """The law of several waves, its hooks, its file and its description say the same."""
    one = Cogging.at(bench.shoulder, bench.model)
    two, three = one.family()[1:]
    assert one.family()[2].more is None
    first, second = np.array([0.3, 0.2, 7.0]), np.array([0.1, -0.2, 3.0])
    more, values = one.once_more(first, second)
    assert more is two
    position = np.linspace(-1.0, 2.0, 50)
    both = one.force(position, position, first) + one.force(position, position, second)
    assert two.force(position, position, values) == pytest.approx(both)
    more, thrice = two.once_more(values, np.array([0.05, 0.0, 11.0]))
    assert more is three and three.once_more(thrice, first) is None
    assert three.force(position, position, thrice) == pytest.approx(both + 0.05 * np.sin(11 * (position - one.center)))
    for effect, numbers in ((two, values), (three, thrice)):
        assert [len(effect.parameters), effect.linear] == [len(numbers), 2 * len(numbers) // 3]
        assert bench.gap(bench.hooks(effect, numbers), bench.force(effect, numbers)) < 1e-12
        assert bench.gap(bench.hooks(effect, numbers), bench.written(effect, numbers)) < 1e-3
        assert one.taking_over(effect, numbers) == pytest.approx(first)
    law = three.describe(thrice)  # the largest wave first
    assert [law["periods"], law["periods_2"], law["periods_3"]] == [7.0, 3.0, 11.0]
    assert law["amplitude_2"] == pytest.approx(np.hypot(0.1, 0.2))
    assert three.describe(two.once_more(values, np.array([0.9, 0.0, 11.0]))[1])["periods"] == 11.0
    assert [p.name for p in two.parameters] == ["sine", "cosine", "sine_2", "cosine_2", "periods", "periods_2"]


@pytest.mark.parametrize(("second", "told"), [(8.4, False), (8.8, True), (5.6, False), (5.2, True)])
def test_waves_are_so_far_apart_that_the_range_tells_them(bench: Any, second: float, told: bool) -> None:
    one = Cogging.at(dataclasses.replace(bench.shoulder, position=(-2.0, 2.0)), bench.model)
    first = np.array([0.3, 0.2, 7.0])
    assert one.plausible(first)
    assert one.family()[1].plausible(one.once_more(first, np.array([0.1, 0.1, second]))[1]) == told
    assert one.family()[1].parameters[-1].low == pytest.approx(3 * 2 * np.pi / 4)


@pytest.mark.parametrize(("seen", "whole"), [(22.8, [22.0, 23.0]), (23.0, []), (0.6, [1.0])])
def test_whole_numbers_of_periods_a_turn_are_tried_beside(bench, seen: float, whole: list[float]) -> None:
    effect = Cogging.at(bench.shoulder, bench.model)
    beside = effect.starts_beside(np.array([0.1, 0.2, seen]))
    assert [values[2] for values in beside if values[2] >= 1.0] == [n for n in whole if n >= effect.parameters[2].low]
    assert all(np.array_equal(values[:2], [0.1, 0.2]) for values in beside)


def test_on_a_slide_and_for_several_waves_no_number_is_whole(bench) -> None:
    slide = Cogging.at(dataclasses.replace(bench.shoulder, position_unit="m"), bench.model)
    assert slide.starts_beside(np.array([0.1, 0.2, 22.8])) == []
    two = Cogging.at(bench.shoulder, bench.model).more
    assert two is not None
    assert two.starts_beside(np.array([0.1, 0.2, 0.1, 0.2, 5.5, 9.5])) == []


def test_a_quick_wave_is_seen_below_slower_ones_that_weigh_more(bench: Any) -> None:
    """The pull on a joint weighs slow waves most, and a residual force has several of them."""
    rng = np.random.default_rng(0)
    effect, position = Cogging.at(bench.shoulder, bench.model), rng.uniform(-1.5, 1.5, 20_000)
    slow = sum(2.0 * np.sin(n * position + n) for n in (7.0, 12.0, 17.0, 22.0))
    pull = slow + np.sin(28.0 * position) + 3.0 * rng.normal(size=len(position))
    seen = effect.scan(position, pull)[:, 2]
    assert np.abs(seen - 28.0).min() < 1.0  # waves are resolved that are two apart
