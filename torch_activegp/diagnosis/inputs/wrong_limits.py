"""Recorded controls that are beyond the limits of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.control_limits import control_limits
from torch_activegp.diagnosis.inputs.runs import Array, input_addresses

_MOSTLY, _FAR = 0.5, 2.0
"""Part of the rows beyond a model's limits by so many times the range between them from which on a control is doubted.
A controller's commands, logged as they are before the drive's limit, are beyond it as often, and not by so much."""
_A_PART = 0.25
"""Of the range between limits, by which some row of a control that is never within is beyond."""
_NOTED, _FEW = 0.1, 0.01
"""Part of the rows beyond them from which on it is noted, and part that is next to none."""


def doubt_limits(model: mujoco.MjModel, recordings: Sequence[Recording]) -> list[str]:
    """Says which controls are so far beyond the model's limits that their unit or column is doubtful.

    In most rows of a recording; or in all of every recording, where a control that changes is never within.

    Args:
        model: nominal.
        recordings: as they are, (T,) rows each.

    Returns:
        Sentences.
    """
    return [
        f"{where}, where it is clipped: {'far beyond' if far else 'never within'}. {_mend(name, rows, limits)}"
        for name, rows, limits, where, far in _doubted(model, recordings)
    ]


def clipping_notes(model: mujoco.MjModel, recordings: Sequence[Recording]) -> list[str]:
    """Says which controls are beyond the model's limits in a tenth of the rows of a recording, and are not doubted.

    Args:
        model: nominal.
        recordings: as they are, (T,) rows each.

    Returns:
        Sentences.
    """
    doubted = {name for name, *_ in _doubted(model, recordings)}
    return [
        f"{where}, to which it is clipped, as MuJoCo does. If the drive gives more than that, mend the model."
        for name, _, _, where in _beyond(model, recordings, _is_clipped)
        if name not in doubted
    ]


def _doubted(
    model: mujoco.MjModel, recordings: Sequence[Recording]
) -> list[tuple[str, Array, tuple[float, float], str, bool]]:
    """Those far beyond in some recording, and those of which no recording has a row within; and which it is."""
    far = [(*one, True) for one in _beyond(model, recordings, _is_far)]
    known = {name for name, *_ in far}
    return far + [(*one, False) for one in _beyond(model, recordings, _is_outside, every=True) if one[0] not in known]


def _is_far(rows: Array, low: float, high: float) -> bool:
    """Whether most rows are far beyond limits."""
    return bool(np.mean(np.maximum(low - rows, rows - high) > _FAR * (high - low)) > _MOSTLY)


def _is_outside(rows: Array, low: float, high: float) -> bool:
    """Whether rows that change are all beyond one end, some by a good part of the range."""
    beyond = np.maximum(low - rows, rows - high).max() > _A_PART * (high - low)
    return bool(beyond and np.ptp(rows) > 0.0 and np.ptp(np.clip(rows, low, high)) == 0.0)


def _is_clipped(rows: Array, low: float, high: float) -> bool:
    """Whether many rows are beyond limits."""
    return _share(rows, low, high) > _NOTED


def _share(rows: Array, low: float, high: float) -> float:
    """The part of some rows that is beyond limits."""
    return float(np.mean((rows < low) | (rows > high)))


def _mend(name: str, rows: Array, limits: tuple[float, float]) -> str:
    """What to do about a control that is far beyond its limits."""
    if _share(-rows, *limits) < _FEW:
        return (
            f"With the other sign it is within: if so, say ctrl.{name} = {{ sign = -1 }} in a column map (--columns)."
        )
    return (
        "If the unit is another one, or the column another actuator's, say so in its line of a column map (--columns "
        "MAP.toml); else mend the model."
    )


def _beyond(
    model: mujoco.MjModel,
    recordings: Sequence[Recording],
    asked: Callable[[Array, float, float], bool],
    every: bool = False,
) -> list[tuple[str, Array, tuple[float, float], str]]:
    """Controls whose rows and limits are so in some, or every recording: names, rows, limits, first words on them."""
    found, (least, most) = [], control_limits(model)
    for name, at in input_addresses(model).items():
        column, limits = f"ctrl.{name}", (float(least[at]), float(most[at]))
        those = [(run.label, run[column].numpy()) for run in recordings if column in run]
        beyond = [(label, rows) for label, rows in those if np.isfinite(limits).all() and asked(rows, *limits)]
        if beyond and (not every or len(beyond) == len(those)):
            all_rows, more = np.concatenate([rows for _, rows in beyond]), len(beyond) - 1
            where = (
                f"{beyond[0][0]}{f' and {more} more' if more else ''}, column `{column}`: {all_rows.min():.3g} to "
                f"{all_rows.max():.3g}, in {_share(all_rows, *limits):.0%} of the rows beyond the model's own limits "
                f"(ctrlrange, {limits[0]:.3g} to {limits[1]:.3g})"
            )
            found.append((name, all_rows, limits, where))
    return found
