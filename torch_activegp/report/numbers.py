"""Numbers as a reader wants them: no more digits than they deserve, and a unit of fitting size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeGuard

MISSING = "\u2013"
_SPACE = "\u00a0"
_SUPERSCRIPT = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "\u00b5"), (1e-9, "n"))
_PREFIXED = ("rad", "m", "s")


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value can be printed as a number; None, NaN and text cannot."""
    return isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)


def number(value: Any, digits: int = 3) -> str:
    """A number with so many significant digits; powers of ten where it is very large or small."""
    if not is_number(value):
        return MISSING
    if math.isinf(value):
        return "\u221e" if value > 0 else "\u2212\u221e"
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -4 <= power < 6:
        return minus(_trim(f"{value:.{max(0, digits - 1 - power)}f}"))
    ten = f"10{str(power).translate(_SUPERSCRIPT)}"
    return ten if _trim(mantissa) == "1" else f"{minus(_trim(mantissa))}\u00d7{ten}"


def percent(share: Any) -> str:
    """A share as per cent; tiny ones and nearly whole ones are not rounded to 0 or 100."""
    if not is_number(share) or math.isinf(share):
        return number(share)
    if 0 < share < 0.001:
        return f"under{_SPACE}0.1{_SPACE}%"
    if 0.9995 <= share < 1:
        return f"over{_SPACE}99.9{_SPACE}%"
    close = share < 0.0995 or 0.985 < share < 1
    text = _trim(f"{100 * share:.1f}") if close else number(100 * share, 2 if share < 1 else 3)
    return f"{text}{_SPACE}%"


def misfit(value: Any) -> str:
    """Chi2 per degree of freedom; small excesses over 1 count, so three decimals there."""
    return f"{value:.3f}" if is_number(value) and abs(value) < 2 else number(value)


def p_value(value: Any) -> str:
    """A p-value with its relation sign."""
    if is_number(value) and value < 1e-12:
        return "p < 10\u207b\u00b9\u00b2"
    return f"p = {number(value, 2)}"


def quantity(value: Any, unit: str, digits: int = 2) -> str:
    """A number with its unit; rad, m and s take the prefix that keeps the number readable."""
    if not is_number(value):
        return MISSING
    scale, prefix = 1.0, ""
    if unit in _PREFIXED and value != 0 and math.isfinite(value):
        scale, prefix = next((pair for pair in _PREFIXES if abs(value) >= 0.1 * pair[0]), _PREFIXES[-1])
    return f"{number(value / scale, digits)}{_SPACE}{prefix}{unit}".rstrip(_SPACE)


def unit_text(unit: Any) -> str:
    """A unit as it is printed: that of a ratio, ``1``, is none."""
    return "" if unit in (None, "1") else str(unit)


def estimate(value: Any, interval: Sequence[Any] | None) -> tuple[str, str]:
    """An estimate and its interval, to the digit that the interval's half width gives a meaning.

    Returns:
        The value, and the interval as ``0.29 to 0.33``; a dash where there is none.
    """
    ends: Sequence[Any] = interval if interval is not None and len(interval) == 2 else (None, None)
    if not all(is_number(end) and math.isfinite(end) for end in (value, *ends)) or ends[0] == ends[1]:
        known = interval is not None and any(map(is_number, ends))
        return number(value), f"{number(ends[0])} to {number(ends[1])}" if known else MISSING
    half = abs(ends[1] - ends[0]) / 2
    power = math.floor(math.log10(half))
    decimals = (1 if half / 10.0**power < 3 else 0) - power
    if decimals > 6 or max(map(abs, (value, *ends))) >= 1e6:
        return number(value, 4), f"{number(ends[0], 4)} to {number(ends[1], 4)}"
    texts = [minus(f"{round(end, decimals) + 0.0:.{max(0, decimals)}f}") for end in (value, *ends)]
    return texts[0], f"{texts[1]} to {texts[2]}"


def minus(text: str) -> str:
    """The text with a true minus sign."""
    return text.replace("-", "\u2212")


def _trim(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text
