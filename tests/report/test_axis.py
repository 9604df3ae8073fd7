from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.report.axis import Axis, axis_over


def test_places_are_a_line_from_end_to_end() -> None:
    assert Axis("x", -2.0, 2.0).place([-2, 0, 1, 2]).tolist() == [0, 500, 750, 1000]
    np.testing.assert_allclose(
        Axis("x", 0.1, 1000.0, log=True).place([0.1, 1, 10, 1000, -5]), [0, 250, 500, 1000, 0], atol=1e-9
    )
    assert np.isnan(Axis("x", 0, 1).place([np.nan])).all()
    assert np.abs(Axis("x", 0, 1).place([-1e30, 1e30])).max() <= 3000


@pytest.mark.parametrize(
    ("axis", "texts"),
    [
        (Axis("", -1.0, 1.0), ["\u22121.0", "\u22120.5", "0", "0.5", "1.0"]),
        (Axis("", 0.0, 4.8), ["0", "1", "2", "3", "4"]),
        (Axis("", -0.0013, 0.0013), ["\u22120.0010", "\u22120.0005", "0", "0.0005", "0.0010"]),
        (
            Axis("", 0.0, 2.5e6),
            ["0", "500000", "10\u2076", "1.5\u00d710\u2076", "2\u00d710\u2076", "2.5\u00d710\u2076"],
        ),
        (Axis("", 0.5, 200.0, log=True), ["1", "10", "100"]),
        (Axis("", 0.5, 40.0, log=True), ["1", "3", "10", "30"]),
        (Axis("", 2.1, 2.9, log=True), ["2.2", "2.4", "2.6", "2.8"]),
    ],
)
def test_ticks_are_round(axis: Axis, texts: list[str]) -> None:
    assert [text for _, text in axis.ticks] == texts
    assert all(0 <= at <= 100 for at, _ in axis.ticks)


@pytest.mark.parametrize("decades", [3, 6, 12, 30])
def test_a_long_logarithmic_axis_has_few_ticks(decades: int) -> None:
    assert 3 <= len(Axis("", 1.0, 10.0**decades, log=True).ticks) <= 8


def test_an_axis_holds_all_that_is_finite() -> None:
    axis = axis_over("x", [0.0, np.nan], [10.0, np.inf], margin=0.1)
    assert (axis.low, axis.high) == (-1.0, 11.0)
    log = axis_over("x", [0.0, -3.0, 1.0, 100.0], log=True, margin=0.0)
    assert (log.low, log.high) == (1.0, 100.0)


@pytest.mark.parametrize("values", [[], [np.nan], [3.0, 3.0], [0.0], [1e-9, 1e-9]])
@pytest.mark.parametrize("log", [False, True])
def test_an_axis_over_nothing_or_one_value_still_has_a_range(values: list[float], log: bool) -> None:
    axis = axis_over("x", values, log=log)
    assert axis.low < axis.high
    assert len(axis.ticks) >= 1
