"""All that makes columns of recordings doubtful, the most certain first."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.runs import Channels, Run
from torch_activegp.diagnosis.inputs.wrong_controls import doubt_controls
from torch_activegp.diagnosis.inputs.wrong_limits import doubt_limits
from torch_activegp.diagnosis.inputs.wrong_units import check_units
from torch_activegp.errors import DataError


def doubt_columns(
    model: mujoco.MjModel,
    channels: Channels,
    recordings: Sequence[Recording],
    runs: Sequence[Run],
    others: Sequence[Run] = (),
) -> list[str]:
    """Says which columns seem to be in another unit, of another sign, or another actuator's.

    Args:
        model: nominal.
        channels: the recorded joints.
        recordings: as they are.
        runs: those of them by which controls are judged.
        others: further ones.

    Returns:
        Sentences.

    Raises:
        DataError: positions are surely in another unit.
    """
    controls = doubt_controls(model, channels, runs)
    try:
        units = [*check_units(model, channels, runs), *check_units(model, channels, others)]
    except DataError as error:
        if controls:  # a motion in mm takes what a force in kN would give
            raise DataError(f"{error} Or another column is: {controls[0]}") from error
        raise
    return [*units, *controls, *doubt_limits(model, recordings)]
