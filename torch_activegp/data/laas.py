"""A brushless joint motor of the Solo robot: current, angle, 1 kHz; friction from reversals, cogging from slow turns.

``acc_current`` reverses the current at up to 150 rad/s for 27 s: inertia and friction show. ``speed_test`` (8 s) and
``speed_test1`` (15 s) turn under a slow speed loop of one turn a second, in which the motor jerks from one cogging
period to the next; in the other half of each file the authors' own compensation was on, and it is left out. The column
that tells the two halves apart means the opposite in the two files: uncompensated is 1 in the first, 0 in the second.

The angle has the same origin in both slow files: so has the phase of the cogging. Now and then a row is stamped some
milliseconds late and the next ones follow in a burst. A late row's angle is then far from where its velocity says, at
150 rad/s by up to 1 rad, while the angle as a whole goes on (over a file the deviations add up to 0.03 rad: it does not
jump). A run is cut at such rows, and parts of less than 0.2 s are left out. The first 0.4 s of ``speed_test`` are left
out too: the motor stands at 0.6 A there, four times what turns it later.

The recorded velocity is left out: it is the drive's own estimate from the same encoder.

Source: heitor-andrade/laas_anti_cogging.
"""

from __future__ import annotations

import itertools
from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd

from torch_activegp.data.public import fetch
from torch_activegp.data.recording import Recording
from torch_activegp.data.tables import read_table
from torch_activegp.errors import DataError

LAAS_FILES = ("acc_current", "speed_test", "speed_test1")
"""What :func:`load_laas` takes."""

_UNCOMPENSATED = {"speed_test": 1, "speed_test1": 0}
_START = {"speed_test": 0.4}
_JUMP = 0.1
_GAP = 5.0
_SHORTEST = 0.2


def load_laas(name: str) -> list[Recording]:
    """Load the runs of one file: ``qpos.rotor`` [rad] and ``ctrl.current``, the q-current Iq [A], nominally at 1 kHz.

    Args:
        name: one of :data:`LAAS_FILES`.

    Raises:
        DataError: if there is no such file, or it is neither in the folder that ``TORCH_ACTIVEGP_DATA`` names nor to be
            had from the network.
    """
    if name not in LAAS_FILES:
        raise DataError(f"LAAS has no recording `{name}`: one of {', '.join(LAAS_FILES)} wanted.")
    path = fetch(f"laas_cogging/{name}.txt")
    table = read_table(path)
    said = "Velocity left out: the drive computed it from the position."
    if name in _UNCOMPENSATED:
        table = table[table["Function Activated"] == _UNCOMPENSATED[name]]
        said += " Only the half without the authors' compensation is taken."
    if name in _START:
        table = table[table["Time"] >= _START[name]]
        said += f" The first {_START[name]} s are left out: the motor stood still."
    pieces = _pieces(table)
    left_out = len(table) - sum(b - a for a, b in pieces)
    if left_out:
        said += f" Cut where a time stamp is late: {left_out} of {len(table)} rows left out."
    return [
        Recording.from_columns(
            path.name,
            {
                "time": table["Time"].to_numpy(float)[a:b],
                "qpos.rotor": table["Position"].to_numpy(float)[a:b],
                "ctrl.current": table["Iq"].to_numpy(float)[a:b],
            },
            run=str(number) if len(pieces) > 1 else None,
            source=path,
            notes=(said,),
        )
        for number, (a, b) in enumerate(pieces, start=1)
    ]


def _pieces(table: pd.DataFrame) -> list[tuple[int, int]]:
    """First and last row (exclusive) of every part between late time stamps that is long enough."""
    time, position, velocity = (table[name].to_numpy(float) for name in ("Time", "Position", "Velocity"))
    steps = np.diff(time)
    jumps = np.abs(np.diff(position) - (velocity[1:] + velocity[:-1]) / 2 * steps) > _JUMP
    late = steps > _GAP * np.median(steps)
    late[1:] |= late[:-1].copy()  # the row after a gap is the late one: cut on both sides of it
    cuts = [0, *(np.flatnonzero(jumps | late) + 1).tolist(), len(time)]
    return [(a, b) for a, b in itertools.pairwise(cuts) if b > a and time[b - 1] - time[a] >= _SHORTEST]


def laas_model() -> Path:
    """Return the path of the nominal simulator, an MJCF file: a rotor of 1.95e-4 A s2/rad, in units of current."""
    return Path(str(resources.files("torch_activegp") / "assets" / "laas.xml"))
