"""The EMPS benchmark: a linear drive under a cascade controller, 24.84 s at 1 kHz, position and motor voltage.

``DATA_EMPS.mat`` is the recording to learn from, ``DATA_EMPS_PULSES.mat`` the one that is held out. The published force
balance is ``95.11 a + 203.5 v + 20.39 sign(v) - 3.16 = 35.15 vir`` (kg, N s/m, N, N, N/V); the nominal model of this
package, ``assets/emps.xml``, keeps its first and its last term only.

The held-out file has a column ``pulses_N`` with steps of 5. They are no external force: ``vir`` leaps by 5.07 V at each
edge, and in a regression of the force balance they get the factor -0.03 where a force in newtons would get 1 (or -1).
They were added to the motor's voltage, ``vir`` holds them already, and so the column is left out.

Reference: Janot, Gautier, Brunot, *Data Set and Reference Models of EMPS*, Nonlinear System Identification Benchmarks
2019.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from torch_activegp.data.loading import load_recordings
from torch_activegp.data.public import fetch
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

EMPS_FILES = {"train": "emps/DATA_EMPS.mat", "test": "emps/DATA_EMPS_PULSES.mat"}
"""Public files of the benchmark, see :func:`~torch_activegp.data.public.fetch`."""


def load_emps(split: str = "train") -> Recording:
    """Load one of the two recordings: ``qpos.slide`` [m] and ``ctrl.motor`` [V], T = 24841 rows at 1 kHz.

    Args:
        split: ``"train"``, or ``"test"`` for the recording with the pulses.

    Raises:
        DataError: if the split is unknown, or the file is neither in the folder that ``TORCH_ACTIVEGP_DATA`` names nor
            to be had from the network.
    """
    if split not in EMPS_FILES:
        raise DataError(f"EMPS has no split `{split}`: one of {', '.join(EMPS_FILES)} wanted.")
    (recording,) = load_recordings(fetch(EMPS_FILES[split]))
    return recording


def emps_model() -> Path:
    """Return the path of the nominal simulator, an MJCF file: a slide of 95.11 kg driven by 35.15 N/V, no losses."""
    return Path(str(resources.files("torch_activegp") / "assets" / "emps.xml"))
