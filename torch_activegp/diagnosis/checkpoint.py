"""Keeps the last finished stage of a long computation in a file, from which the same computation goes on."""

from __future__ import annotations

import dataclasses
import logging
import pickle
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from torch_activegp.diagnosis.result import written_whole
from torch_activegp.physics.effect import Effect

_logger = logging.getLogger(__name__)
_ARRAYS = frozenset({"ndarray", "dtype", "_reconstruct", "scalar"})
_OURS = "torch_activegp.diagnosis."
_PROTOCOL = 4
Value = TypeVar("Value")


class Checkpoint:
    """A file with the last finished stage of a diagnosis.

    An interrupted call of :func:`~torch_activegp.diagnosis.diagnose` with the same input goes on from there, and finds
    the same; with another input, or another version of this package, it starts anew. The file stays until it is
    cleared, so that nothing is lost before the result is saved.

    Args:
        path: of the file; None to keep nothing.

    Example:
        >>> checkpoint = Checkpoint("out/.progress")
        >>> # diagnosis = diagnose("arm.xml", recordings, checkpoint=checkpoint)
        >>> # diagnosis.save("out")
        >>> checkpoint.clear()
    """

    def __init__(self, path: Path | str | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.stage: str | None = None
        """The last stage that is kept."""
        self.resumed: str | None = None
        """The stage after which this call went on."""
        self._key: str | None = None
        self._shared: list[object] = []

    def open(self, key: str) -> None:
        """Looks for a stage that an earlier call kept.

        Args:
            key: one word for the whole input; what was kept under another one does not count.
        """
        self._key, self.stage = key, None
        if self.path is not None and self.path.is_file():
            with self.path.open("rb") as file:
                found, _, stage = file.readline().decode("utf-8", "replace").rstrip("\n").partition(" ")
            self.stage = stage if found == key else None

    def share(self, objects: Iterable[object]) -> None:
        """Names objects that the stages refer to and that every call makes anew, in the same order."""
        self._shared = list(objects)

    def once(self, stage: str, compute: Callable[[], Value]) -> Value:
        """The value of a stage: what an earlier call kept, or else what is computed, which is kept then.

        A stage takes the place of the one before, so a computation asks for its last stage first, and that for what it
        needs. The value comes from the file in either case: whatever follows cannot tell whether it was interrupted.
        """
        if self.path is None or self._key is None:
            return compute()
        if self.stage == stage:
            found, self.stage = self._read(), None
            if found:
                self.stage = self.resumed = stage
                return found[0]
        value = compute()
        if self._write(stage, value):
            found = self._read()
            return found[0] if found else value
        return value

    def clear(self) -> None:
        """Removes the file."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)
        self.stage = None

    def _write(self, stage: str, value: object) -> bool:
        assert self.path is not None
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with written_whole(self.path) as temporary, temporary.open("wb") as file:
                file.write(f"{self._key} {stage}\n".encode())
                _Pickler(file, self._shared).dump(value)
        except (OSError, pickle.PicklingError, TypeError, AttributeError) as error:
            _logger.warning("%s is not kept: %s", stage, error)
            return False
        self.stage = stage
        return True

    def _read(self) -> list[Any]:
        """The value in the file, alone in a list; an empty list where it cannot be read."""
        assert self.path is not None
        try:
            with self.path.open("rb") as file:
                file.readline()
                return [_Unpickler(file, self._shared).load()]
        except (OSError, EOFError, pickle.UnpicklingError, AttributeError, IndexError, TypeError, ValueError) as error:
            _logger.warning("%s cannot be read: %s", self.path, error)
            return []


class _Pickler(pickle.Pickler):
    """Writes values, and of what is shared only the number."""

    def __init__(self, file: BinaryIO, shared: list[object]) -> None:
        super().__init__(file, protocol=_PROTOCOL)
        self._numbers = {id(item): number for number, item in enumerate(shared)}

    def persistent_id(self, obj: object) -> int | None:
        number = self._numbers.get(id(obj))
        if number is None and isinstance(obj, Effect):
            raise pickle.PicklingError(f"{obj.name} at {obj.target} is not among the effects that were tried")
        return number


class _Unpickler(pickle.Unpickler):
    """Reads values: arrays and the dataclasses of the diagnosis, and runs nothing else that a file may ask for."""

    def __init__(self, file: BinaryIO, shared: list[object]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: int) -> object:
        return self._shared[pid]

    def find_class(self, module: str, name: str) -> Any:
        if module.partition(".")[0] == "numpy" and name in _ARRAYS:
            return super().find_class(module, name)
        if module.startswith(_OURS) and "." not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and dataclasses.is_dataclass(found):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} does not belong there")
