from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report.numbers import MISSING, estimate, misfit, number, p_value, percent, quantity


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (3.14159, "3.14"),
        (2.0, "2"),
        (-0.5, "\u22120.5"),
        (1234.5, "1234"),
        (0.00034567, "0.000346"),
        (1.2e-9, "1.2\u00d710\u207b\u2079"),
        (1e-9, "10\u207b\u2079"),
        (-3.4e7, "\u22123.4\u00d710\u2077"),
        (0.9996, "1"),
        (float("inf"), "\u221e"),
        (float("-inf"), "\u2212\u221e"),
        (float("nan"), MISSING),
        (None, MISSING),
        ("text", MISSING),
    ],
)
def test_numbers(value: Any, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.91, "91 %"),
        (0.002, "0.2 %"),
        (0.07, "7 %"),
        (0.0004, "under 0.1 %"),
        (0.998, "99.8 %"),
        (0.99999, "over 99.9 %"),
        (1.0, "100 %"),
        (2.4, "240 %"),
        (0.0, "0 %"),
        (None, MISSING),
        (float("inf"), "\u221e"),
    ],
)
def test_shares_are_never_rounded_to_nothing_or_all(share: Any, text: str) -> None:
    assert percent(share).replace("\u00a0", " ") == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (3.1e-4, "rad", "0.31 mrad"),
        (0.25, "rad", "0.25 rad"),
        (2e-6, "m", "2 \u00b5m"),
        (3e-4, "N m", "0.0003 N m"),
        (0.0, "rad", "0 rad"),
        (1.5, "", "1.5"),
        (None, "rad", MISSING),
    ],
)
def test_quantities_take_a_fitting_prefix(value: Any, unit: str, text: str) -> None:
    assert quantity(value, unit).replace("\u00a0", " ") == text


@pytest.mark.parametrize(
    ("value", "interval", "texts"),
    [
        (0.31234, [0.2931, 0.3309], ("0.312", "0.293 to 0.331")),
        (0.034, [0.0, 0.068], ("0.03", "0.00 to 0.07")),
        (-12.34, [-17.2, -7.5], ("\u221212", "\u221217 to \u22128")),
        (1234.0, [700.0, 1700.0], ("1200", "700 to 1700")),
        (3e-9, [2e-9, 4e-9], ("3\u00d710\u207b\u2079", "2\u00d710\u207b\u2079 to 4\u00d710\u207b\u2079")),
        (0.3, None, ("0.3", MISSING)),
        (0.3, [None, None], ("0.3", MISSING)),
        (0.3, [0.2, float("inf")], ("0.3", "0.2 to \u221e")),
        (0.3, [0.3, 0.3], ("0.3", "0.3 to 0.3")),
    ],
)
def test_an_estimate_has_the_digits_of_its_interval(value: Any, interval: Any, texts: tuple[str, str]) -> None:
    assert estimate(value, interval) == texts


def test_small_misfits_keep_their_excess() -> None:
    assert [misfit(value) for value in (1.02, 8.13, 640.2, None)] == ["1.020", "8.13", "640", MISSING]


def test_p_values() -> None:
    assert p_value(0.43) == "p = 0.43"
    assert p_value(0.0) == "p < 10\u207b\u00b9\u00b2"
