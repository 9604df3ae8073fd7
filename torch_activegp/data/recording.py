"""A recording: what one run of a machine measured, as a value."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from torch_activegp.data.checks import KINDS, check_columns
from torch_activegp.errors import DataError

if TYPE_CHECKING:
    from tensordict import TensorDict


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """One run: row k holds the state at ``time[k]`` and the control applied from then until ``time[k + 1]``.

    Build one with :meth:`from_columns` or :func:`~torch_activegp.data.load_recordings`.

    Args:
        name: what messages call it, usually the file's name.
        values: columns ``(T,)`` by canonical name, float64, SI units: ``time``, ``qpos.<joint>``, ``qvel.<joint>``,
            ``ctrl.<actuator>``, ``qfrc.<joint>``.
        run: which run of the file this is, or None where the file holds one.
        source: the file it was read from.
        notes: what the loader had to decide, in sentences.
        prescribed: joints that something else moved, or held, along the recorded positions: an input of the machine,
            for :func:`~torch_activegp.diagnosis.diagnose` and :func:`~torch_activegp.diagnosis.evaluate`.
        video: whether positions were taken from a video, whose errors last for half a second and more.

    >>> recording = Recording.from_columns("swing", {"time": [0.0, 0.1, 0.2, 0.3], "qpos.elbow": [0.0, 0.1, 0.3, 0.6]})
    >>> print(recording)
    swing: 4 rows, 0.3 s at 10 Hz; joints elbow; no actuators; no velocities
    >>> recording["qpos.elbow"].tolist()
    [0.0, 0.1, 0.3, 0.6]
    """

    name: str
    values: Mapping[str, Tensor]
    run: str | None = None
    source: Path | None = None
    notes: tuple[str, ...] = ()
    prescribed: tuple[str, ...] = ()
    video: bool = False

    @classmethod
    def from_columns(cls, name: str, columns: Mapping[str, Any], **fields: Any) -> Recording:
        """Build a recording from columns by their canonical names.

        Args:
            name: what messages call it.
            columns: ``time`` [s], ``qpos.<joint>``, ``qvel.<joint>``, ``ctrl.<actuator>``, ``qfrc.<joint>``; each
                ``(T,)``, T >= 4: tensors, arrays or lists.
            fields: ``run``, ``source``, ``notes``, ``prescribed`` and ``video`` of the recording.

        Raises:
            DataError: if the columns are no recording (see :func:`~torch_activegp.data.checks.check_columns`), or a
                prescribed joint has no position.
        """
        arrays = {column: np.asarray(given, dtype=np.float64) for column, given in columns.items()}
        for column, array in arrays.items():
            if array.ndim != 1:
                raise DataError(f"{name}, column `{column}`: shape (T,) wanted, found {array.shape}. Split it up.")
        check_columns(arrays, name)
        values = {column: torch.from_numpy(array.copy()) for column, array in arrays.items()}
        recording = cls(name=name, values=values, **fields)
        for joint in recording.prescribed:
            if f"qpos.{joint}" not in recording:
                raise DataError(
                    f"{recording.label}: no column `qpos.{joint}`, and `{joint}` is said to be prescribed; found "
                    f"{', '.join(recording.columns)}. Record its position, or mend `prescribed`."
                )
        return recording

    def __getitem__(self, column: str) -> Tensor:
        """Return a column ``(T,)`` by its canonical name.

        Raises:
            DataError: if there is no such column; the message lists those that are there.
        """
        if column not in self:
            raise DataError(f"{self.label}: no column `{column}`, found {', '.join(self.columns)}.")
        return self.values[column]

    def __contains__(self, column: object) -> bool:
        return column in self.columns

    def __len__(self) -> int:
        return len(self.time)

    def replace(self, columns: Mapping[str, Tensor], note: str | None = None) -> Recording:
        """Return a copy with columns added or replaced, and one more note."""
        merged = {column: self[column] for column in self.columns} | dict(columns)
        notes = self.notes if note is None else (*self.notes, note)
        fields = {"run": self.run, "source": self.source, "prescribed": self.prescribed, "video": self.video}
        return Recording.from_columns(self.name, merged, notes=notes, **fields)

    @property
    def data(self) -> TensorDict:
        """The columns as a locked TensorDict of batch ``(T,)``: ``"time"``, nested ``("qpos", joint)`` and so on."""
        from tensordict import TensorDict  # with torch's compiler: 2 s, which a shell command would wait for in vain

        data = TensorDict({}, batch_size=[len(self)])
        for column, values in self.values.items():
            data[_key(column)] = values
        return data.lock_()

    @property
    def label(self) -> str:
        """Name and run, for messages."""
        return self.name if self.run is None else f"{self.name} (run {self.run})"

    @property
    def columns(self) -> tuple[str, ...]:
        """Canonical names of all columns, ``time`` first."""
        return ("time", *(f"{kind}.{name}" for kind in KINDS for name in self._names([kind])))

    @property
    def time(self) -> Tensor:
        """Clock ``(T,)``, s."""
        return self.values["time"]

    @property
    def dt(self) -> float:
        """Median time step, s."""
        return float(np.median(np.diff(self.time.numpy())))

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints with a recorded position or velocity."""
        return self._names(["qpos", "qvel"])

    @property
    def actuators(self) -> tuple[str, ...]:
        """Actuators with a recorded control."""
        return self._names(["ctrl"])

    def _names(self, kinds: Sequence[str]) -> tuple[str, ...]:
        found = [column.partition(".") for column in self.values]
        return tuple(dict.fromkeys(name for wanted in kinds for kind, _, name in found if kind == wanted))

    def __str__(self) -> str:
        seconds = float(self.time[-1] - self.time[0])
        missing = [joint for joint in self.joints if f"qvel.{joint}" not in self]
        velocities = "no velocities" if len(missing) == len(self.joints) else f"no velocity of {', '.join(missing)}"
        parts = [
            f"{self.label}: {len(self)} rows, {seconds:.6g} s at {1 / self.dt:.6g} Hz",
            f"joints {', '.join(self.joints)}",
            f"actuators {', '.join(self.actuators)}" if self.actuators else "no actuators",
        ]
        parts += [velocities] if missing else []
        return "; ".join([*parts, f"prescribed: {', '.join(self.prescribed)}"] if self.prescribed else parts)

    def __repr__(self) -> str:
        return f"<Recording {self}>"


def _key(column: str) -> str | tuple[str, str]:
    kind, dot, name = column.partition(".")
    return (kind, name) if dot else kind
