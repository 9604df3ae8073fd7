"""Recordings of machines: loaded, checked, and turned into TensorDicts."""

from torch_activegp.data.angles import unwrap_angles
from torch_activegp.data.columns import ColumnMap, ColumnRule
from torch_activegp.data.emps import emps_model, load_emps
from torch_activegp.data.loading import load_recordings
from torch_activegp.data.noise import noise_std
from torch_activegp.data.public import PUBLIC_FILES, fetch
from torch_activegp.data.recording import Recording
from torch_activegp.data.resampling import resample
from torch_activegp.data.transitions import to_transitions
from torch_activegp.data.velocities import choose_window, estimate_velocities

__all__ = [
    "PUBLIC_FILES",
    "ColumnMap",
    "ColumnRule",
    "Recording",
    "choose_window",
    "emps_model",
    "estimate_velocities",
    "fetch",
    "load_emps",
    "load_recordings",
    "noise_std",
    "resample",
    "to_transitions",
    "unwrap_angles",
]
