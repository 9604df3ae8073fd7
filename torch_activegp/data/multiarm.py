"""The MultiArm single pendulum: it swings freely from 1.6 rad and comes nearly to rest, 55 s at 1 kHz, no input.

The angle is measured from the upright position: pi is hanging. The authors published pieces that follow each other
without a gap; here the four of their identification set are one recording of 36.7 s, the two of their validation set
one of 18.3 s. Their velocity is left out: it follows from the position (a linear filter over 80 ms of it explains it to
0.02 rad/s, of 4.6 rad/s rms), and so measures nothing more.

The nominal model, ``assets/multiarm.xml``, is the authors' own calibrated one, whose only loss is viscous.

Reference: Kaheman et al., *The Experimental Multi-Arm Pendulum on a Cart*, arXiv 2205.06231.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import scipy.io

from torch_activegp.data.public import fetch
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

_FILE = "multiarm_single/SinglePendulumDataForParameterEstimation.mat"
_PIECES = {"train": ("Time_id", "Y_id"), "test": ("Time_vad", "Y_vad")}
MULTIARM_SPLITS = tuple(_PIECES)
"""What :func:`load_multiarm` takes."""


def load_multiarm(split: str = "train") -> Recording:
    """Load one of the two recordings: ``qpos.arm`` [rad] at 1 kHz, T = 36668 (train) or 18333 (test).

    Args:
        split: ``"train"``, the first 36.7 s, or ``"test"``, the 18.3 s that follow.

    Raises:
        DataError: if the split is unknown, or the file is neither in the folder that ``TORCH_ACTIVEGP_DATA`` names nor
            to be had from the network.
    """
    if split not in _PIECES:
        raise DataError(f"MultiArm has no split `{split}`: one of {', '.join(_PIECES)} wanted.")
    content = scipy.io.loadmat(fetch(_FILE))
    times, states = (content[name].ravel() for name in _PIECES[split])
    columns = {
        "time": np.concatenate([time.ravel() for time in times]),
        "qpos.arm": np.concatenate([state[0] for state in states]),
    }
    note = f"{len(times)} pieces joined. Velocity left out: the authors computed it from the position."
    return Recording.from_columns(f"multiarm_{split}", columns, notes=(note,))


def multiarm_model() -> Path:
    """Return the path of the nominal simulator, an MJCF file: the authors' pendulum with viscous friction only."""
    return Path(str(resources.files("torch_activegp") / "assets" / "multiarm.xml"))
