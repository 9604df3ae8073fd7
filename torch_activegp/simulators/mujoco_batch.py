"""Many MuJoCo simulations on all cores, each starting from the state it is given and from nothing else."""

from __future__ import annotations

import logging
import os
import threading
from typing import Any

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.mujoco_timers import without_timers
from torch_activegp.simulators.mujoco_warnings import warnings_to

Array = NDArray[np.float64]

_STATE = mujoco.mjtState
_RECORD = _STATE.mjSTATE_TIME.value | _STATE.mjSTATE_QPOS.value | _STATE.mjSTATE_QVEL.value | _STATE.mjSTATE_ACT.value
_logger = logging.getLogger(__name__)
_inherited: list[mujoco.batch.Batch] = []  # batches of a parent process; their threads do not exist here


class BatchRunner:
    """Runs batches of one model on a pool of threads that is made at the first call.

    Everything that a state does not hold (warm start of the solver, history of delayed actuators, plastic deformation,
    mocap bodies) starts as after ``mj_resetData``, so equal inputs give equal bits whatever ran in between. Pickling
    and copying keep the model alone; a forked process makes threads of its own.

    Args:
        model: compiled model; must not change afterwards.
        nthread: number of threads; None for all cores that this process may use.
        external_force: controls hold one generalised force for each degree of freedom after the nu controls.
    """

    def __init__(self, model: mujoco.MjModel, nthread: int | None = None, external_force: bool = False) -> None:
        self.model = model
        self.nthread = nthread
        self.external_force = external_force
        self._lock = threading.Lock()
        self._batch: mujoco.batch.Batch | None = None
        self._reset_row: Array | None = None
        self._views: dict[str, Array] = {}
        self._pid = os.getpid()

    def __getstate__(self) -> dict[str, Any]:
        return {"model": self.model, "nthread": self.nthread, "external_force": self.external_force}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def step(self, physics: Array, control: Array, nstep: int) -> Array:
        """Advances n simulations by nstep time steps of the model, the control held.

        Args:
            physics: ``(n, nq + nv + na)``.
            control: ``(n, nu)``, or ``(n, nu + nv)`` with external forces.
            nstep: number of time steps.

        Returns:
            ``(n, nq + nv + na)``; NaN in the rows of simulations that MuJoCo warned about or could not finish.
        """
        with self._lock, warnings_to(_logger.debug), without_timers():
            batch, ids = self._load(physics)
            nu, count = self.model.nu, len(physics)
            self._views["ctrl"][:count] = control[:, :nu]
            if self.external_force:
                self._views["qfrc_applied"][:count] = control[:, nu:]
            try:
                batch.step(ids, nstep)
            except mujoco.batch.SimulationError as error:
                _logger.debug("%s", error)
            after = np.concatenate([self._views[name][:count] for name in ("qpos", "qvel", "act")], axis=-1)
            after[self._failed(batch, count)] = np.nan
            return after

    def rollout(self, physics: Array, controls: Array, nstep: int) -> Array:
        """Advances n simulations through T controls, each held for nstep time steps of the model, in one native call.

        Args:
            physics: ``(n, nq + nv + na)``.
            controls: ``(n, T, nu)``, or ``(n, T, nu + nv)`` with external forces.
            nstep: number of time steps for each control.

        Returns:
            ``(n, T, nq + nv + na)``; NaN in a row from the control on at which MuJoCo warned or could not finish.
        """
        if controls.shape[1] == 0:
            return np.empty((len(physics), 0, physics.shape[-1]))
        spec = _STATE.mjSTATE_CTRL.value | (_STATE.mjSTATE_QFRC_APPLIED.value if self.external_force else 0)
        with self._lock, warnings_to(_logger.debug), without_timers():
            batch, ids = self._load(physics)
            repeated = np.repeat(controls, nstep, axis=1)
            shape = (*repeated.shape[:2], 1 + physics.shape[-1])
            out = {_RECORD: np.full(shape, np.nan)}
            try:
                batch.rollout(repeated.shape[1], repeated, spec, [_RECORD], ids, out)
            except mujoco.batch.SimulationError as error:
                _logger.debug("%s", error)
            record = out[_RECORD]
            for index in self._failed(batch, len(physics)).nonzero()[0]:
                record[index, _first_bad(record[index]) :] = np.nan
            return record[:, nstep - 1 :: nstep, 1:].copy()

    def _load(self, physics: Array) -> tuple[mujoco.batch.Batch, NDArray[np.int32] | None]:
        count, model = len(physics), self.model
        batch = self._batch_for(count)
        batch.state[:count] = self._reset_row
        self._views["qpos"][:count] = physics[:, : model.nq]
        self._views["qvel"][:count] = physics[:, model.nq : model.nq + model.nv]
        self._views["act"][:count] = physics[:, model.nq + model.nv :]
        batch.warning[:count] = 0
        return batch, None if count == batch.nsim else np.arange(count, dtype=np.int32)

    def _batch_for(self, count: int) -> mujoco.batch.Batch:
        if self._batch is not None and self._pid != os.getpid():
            _inherited.append(self._batch)  # closing it would wait for threads that did not survive the fork
            self._batch = None
        if self._batch is None or self._batch.nsim < count:
            capacity = 1 << max(count - 1, 0).bit_length()
            try:
                self._batch = mujoco.batch.Batch(self.model, capacity, self.nthread or _usable_cores())
            except ValueError as error:
                raise ConfigurationError(
                    f"MuJoCo cannot run this model in batches: {error}. Turn that feature off in the model."
                ) from error
            self._pid = os.getpid()
            self._reset_row = self._batch.state[0].copy()
            self._views = {name: self._batch.bind(name) for name in ("qpos", "qvel", "act", "ctrl", "qfrc_applied")}
        return self._batch

    @staticmethod
    def _failed(batch: mujoco.batch.Batch, count: int) -> NDArray[np.bool_]:
        return (batch.warning[:count, :, 1] > 0).any(axis=1) | (batch.status[:count] != 0)


def _first_bad(record: Array) -> int:
    """Index of the row that failed: MuJoCo repeats it to the end. Time, in the first column, tells good rows apart."""
    same = (record[1:] == record[:-1]) | (np.isnan(record[1:]) & np.isnan(record[:-1]))
    changed = (~same.all(axis=1)).nonzero()[0]
    return int(changed[-1]) + 1 if len(changed) else 0


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
