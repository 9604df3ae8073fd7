"""Eleven balls dropped twice from a bridge: 47 m of height in about 3 s, at 15 Hz from video.

The first drop of each ball is the one to learn from, the second the one that is held out. Heights stand in steps of
about 3 cm (pixels), and err by some tenths of a metre in ways that noise does not: the ball rests or still rises while
the hand lets go, and the last few frames before the ground lag. The published velocity is smoothed from the heights,
and so left out.

The nominal model, ``assets/balls.xml``, is free fall of 1 kg: no mass shows in free fall, and what drag there is comes
out as drag coefficient over mass.

Reference: de Silva et al., *Discovery of Physics From Data: Universal Laws and Discrepancies*, Frontiers in Artificial
Intelligence 2020.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import pandas as pd

from torch_activegp.data.public import fetch
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

BALLS = (
    "baseball",
    "blue_basketball",
    "green_basketball",
    "volleyball",
    "bowling_ball",
    "golf_ball",
    "tennis_ball",
    "whiffle_ball_1",
    "whiffle_ball_2",
    "yellow_whiffle_ball",
    "orange_whiffle_ball",
)
"""What :func:`load_balls` takes: the sheets of the file, in its order."""

DROPS = (1, 2)
"""The first drop is to learn from, the second held out."""


def load_balls(ball: str, drop: int = 1) -> Recording:
    """Load one drop: ``qpos.height`` [m], T = 42 to 58 rows at 15 Hz.

    Args:
        ball: one of :data:`BALLS`.
        drop: 1 or 2.

    Raises:
        DataError: if there is no such ball or drop, or the file is neither in the folder that ``TORCH_ACTIVEGP_DATA``
            names nor to be had from the network.
    """
    if ball not in BALLS or drop not in DROPS:
        raise DataError(f"no drop {drop} of a ball `{ball}`: drop 1 or 2 of {', '.join(BALLS)} wanted.")
    path = fetch("balls/Ball_drops_data.xls")
    table = pd.read_excel(path, sheet_name=ball.replace("_", " ").title(), engine="calamine")
    rows = table[table["Drop #"] == drop]
    columns = {"time": rows["Time (s)"].to_numpy(float), "qpos.height": rows["Height (m)"].to_numpy(float)}
    note = "Velocity left out: the authors computed it from the height."
    return Recording.from_columns(f"{ball}_{drop}", columns, notes=(note,), video=True)


def balls_model() -> Path:
    """Return the path of the nominal simulator, an MJCF file: 1 kg in free fall at 9.81 m/s2."""
    return Path(str(resources.files("torch_activegp") / "assets" / "balls.xml"))
