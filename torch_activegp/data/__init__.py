"""Recordings of machines: loaded, checked, and turned into TensorDicts."""

from importlib import import_module
from typing import TYPE_CHECKING

from torch_activegp.data.angles import unwrap_angles
from torch_activegp.data.balls import balls_model, load_balls
from torch_activegp.data.columns import ColumnMap, ColumnRule
from torch_activegp.data.emps import emps_model, load_emps
from torch_activegp.data.known_sets import known_model, known_names, known_recordings
from torch_activegp.data.laas import laas_model, load_laas
from torch_activegp.data.loading import load_recordings
from torch_activegp.data.multiarm import load_multiarm, multiarm_model
from torch_activegp.data.noise import noise_std
from torch_activegp.data.public import PUBLIC_FILES, fetch
from torch_activegp.data.recording import Recording
from torch_activegp.data.resampling import resample
from torch_activegp.data.velocities import choose_window, estimate_velocities

if TYPE_CHECKING:
    from torch_activegp.data.transitions import to_transitions

__all__ = [
    "PUBLIC_FILES",
    "ColumnMap",
    "ColumnRule",
    "Recording",
    "balls_model",
    "choose_window",
    "emps_model",
    "estimate_velocities",
    "fetch",
    "known_model",
    "known_names",
    "known_recordings",
    "laas_model",
    "load_balls",
    "load_emps",
    "load_laas",
    "load_multiarm",
    "load_recordings",
    "multiarm_model",
    "noise_std",
    "resample",
    "to_transitions",
    "unwrap_angles",
]


if not TYPE_CHECKING:  # a type checker would let any name pass

    def __getattr__(name: str) -> object:
        """Import what needs TensorDict where it is wanted: that takes 2 s, and a diagnosis does without."""
        if name != "to_transitions":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = globals()[name] = import_module("torch_activegp.data.transitions").to_transitions
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
