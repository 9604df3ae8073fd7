"""Models of simulations side by side that differ in some of their fields."""

from __future__ import annotations

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.physics.effect import field_of


class Fields:
    """Fields of a batch's model with one value for each simulation, put back after use."""

    def __init__(self, batch: mujoco.batch.Batch) -> None:
        self.batch = batch
        self._stale = np.zeros(batch.nsim, dtype=bool)

    def __call__(self, name: str) -> Array:
        """One field, to write, by the name that :func:`field_of` takes."""
        return self.batch.expand(name)

    def derive(self, edited: NDArray[np.bool_]) -> None:
        """Computes the constants of the first simulations that are edited, or were and still have what followed."""
        stale = self._stale[: len(edited)]
        if len(changed := np.flatnonzero(edited | stale)):
            self.batch.set_const(changed.astype(np.int32))
        stale[:] = edited

    def restore(self, model: mujoco.MjModel) -> None:
        """Puts back what was written."""
        for name in list(self.batch._expanded):
            self.batch.expand(name)[...] = field_of(model, name)
