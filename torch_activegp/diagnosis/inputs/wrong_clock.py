"""Times in milliseconds that are read as seconds, seen by how far apart rows are."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from torch_activegp.data import Recording
from torch_activegp.errors import DataError

_SLOWEST, _QUICKEST = 0.5, 2e-5
"""How far apart rows of no machine are, s: at two a second no segment shows its motion, and no encoder is read at
50 kHz."""
_STEPS, _PART = 200, 50
"""And so many of the model's time steps, or such a part of one."""
_PLAUSIBLE = 1e-4, 0.1
"""Between rows in another unit, s."""
_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def check_clock_unit(model: mujoco.MjModel, recordings: Sequence[Recording]) -> None:
    """Refuses rows that are too far apart, or too near, for any machine, and would not be in another unit.

    At 100 Hz in milliseconds rows are 10 s apart: each takes thousands of time steps, and nothing is found in the end.

    Args:
        model: nominal.
        recordings: of it.

    Raises:
        DataError: times seem to be in another unit.
    """
    step = float(model.opt.timestep)
    for recording in recordings:
        apart = float(recording.time.diff().median()) if len(recording) > 1 else step
        found = f"{recording.label}, column `time`: s wanted, found rows {apart:.3g} s apart"
        slow, quick = apart >= max(_SLOWEST, _STEPS * step), apart <= min(_QUICKEST, step / _PART)
        for unit, factor in _UNITS.items():
            if slow and _PLAUSIBLE[0] <= apart * factor <= _PLAUSIBLE[1]:
                raise DataError(
                    f"{found}, each {apart / step:.3g} time steps of the model. In {unit} they would be "
                    f"{apart * factor:.3g} s apart. Name the unit in its line of a column map (--columns MAP.toml): "
                    f'time = {{ column = "...", unit = "{unit}" }}.'
                )
            if quick and _PLAUSIBLE[0] <= apart / factor <= _PLAUSIBLE[1]:
                raise DataError(
                    f"{found}, {step / apart:.3g} in each time step of the model. Check the unit in its line of the "
                    "column map: without one, times are in s."
                )
