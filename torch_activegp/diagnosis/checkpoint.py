"""Keeps the last finished stage of a long computation in a file, from which the same computation goes on."""

from __future__ import annotations

import dataclasses
import io
import logging
import pickle
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from torch_activegp.files import written_whole
from torch_activegp.physics.effect import Effect

_logger = logging.getLogger(__name__)
_ARRAYS = frozenset({"ndarray", "dtype", "_reconstruct", "scalar"})
_OURS = "torch_activegp.diagnosis."
_PROTOCOL = 4
_UNFIT = (pickle.PickleError, EOFError, AttributeError, IndexError, TypeError, ValueError)
"""What pickle raises at a value that it cannot hold, or at bytes that it cannot read."""
Value = TypeVar("Value")


class Checkpoint:
    """A file with the last finished stage of a diagnosis.

    An interrupted call of :func:`~torch_activegp.diagnosis.diagnose` with the same input goes on from there, and finds
    the same; with another input, or another version of this package, it starts anew. The file stays until it is
    cleared, so that nothing is lost before the result is saved.

    Args:
        path: of the file, or a function that gives it for the key of the input; None to keep nothing.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as out:
        ...     checkpoint = Checkpoint(f"{out}/.progress")
        ...     # diagnosis = diagnose("arm.xml", recordings, checkpoint=checkpoint)
        ...     # diagnosis.save(out)
        ...     checkpoint.clear()
    """

    def __init__(self, path: Path | str | Callable[[str], Path] | None = None) -> None:
        self._place = path if callable(path) else None
        self.path = None if path is None or callable(path) else Path(path)
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
        if self._place is not None:
            self.path = self._place(key)
        if self.path is not None:
            found, stage = kept(self.path)
            self.stage = stage if found == key else None
            if found not in (None, key):
                _logger.warning(
                    "%s keeps an interrupted diagnosis of other recordings, another model or other options. This one "
                    "starts anew and takes its place.",
                    self.path,
                )

    def share(self, objects: Iterable[object]) -> None:
        """Names objects that the stages refer to and that every call makes anew, in the same order."""
        self._shared = list(objects)

    def once(self, stage: str, compute: Callable[[], Value]) -> Value:
        """The value of a stage: what an earlier call kept, or else what is computed, which is kept then.

        A stage takes the place of the one before, so a computation asks for its last stage first, and that for what it
        needs. The value is unpickled in either case, here from the same bytes that go to the file: whatever follows
        cannot tell whether it was interrupted, nor what another process wrote meanwhile.
        """
        if self.path is None or self._key is None:
            return compute()
        if self.stage == stage:
            found, self.stage = self._read(stage), None
            if found:
                self.stage = self.resumed = stage
                return found[0]
        value = compute()
        try:
            pickled = self._pickled(value)
            same: Value = self._unpickled(pickled)
        except _UNFIT as error:
            _logger.warning("%s is not kept: %s", stage, error)
            return value
        self._write(stage, pickled)
        return same

    def clear(self) -> None:
        """Removes the file."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)
        self.stage = None

    def _header(self, stage: str) -> bytes:
        return f"{self._key} {stage}\n".encode()

    def _pickled(self, value: object) -> bytes:
        file = io.BytesIO()
        _Pickler(file, self._shared).dump(value)
        return file.getvalue()

    def _unpickled(self, pickled: bytes) -> Any:
        return Unpickler(io.BytesIO(pickled), self._shared).load()

    def _write(self, stage: str, pickled: bytes) -> None:
        """Puts a stage in the file, if the disk allows it."""
        assert self.path is not None
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with written_whole(self.path) as file:
                file.write(self._header(stage) + pickled)
        except OSError as error:
            _logger.warning("%s is not kept: %s", stage, error)
        else:
            self.stage = stage

    def _read(self, stage: str) -> list[Any]:
        """The value in the file, alone in a list; an empty list where it is another's or cannot be read."""
        assert self.path is not None
        try:
            header, _, pickled = self.path.read_bytes().partition(b"\n")
            return [self._unpickled(pickled)] if header + b"\n" == self._header(stage) else []
        except (OSError, *_UNFIT) as error:
            _logger.warning("%s cannot be read: %s", self.path, error)
            with suppress(OSError):
                self.path.unlink(missing_ok=True)
            return []


def kept(path: Path) -> tuple[str | None, str | None]:
    """The key and the stage of what a file keeps; None for both where there is none."""
    try:
        with path.open("rb") as file:
            key, _, stage = file.readline().decode("utf-8", "replace").rstrip("\n").partition(" ")
    except FileNotFoundError:
        return None, None
    except OSError as error:
        _logger.warning("%s cannot be read: %s", path, error)
        return None, None
    return key, stage


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


class Unpickler(pickle.Unpickler):
    """Reads values: arrays and this package's dataclasses, and runs nothing else that a file may ask for.

    Args:
        file: to read.
        shared: objects that the file refers to by number.
        ours: how the names of modules begin whose dataclasses are read.
        known: further classes.
    """

    def __init__(
        self, file: BinaryIO, shared: Sequence[object] = (), ours: str = _OURS, known: Sequence[type] = ()
    ) -> None:
        super().__init__(file)
        self._shared, self._ours = shared, ours
        self._known = {(kind.__module__, kind.__qualname__): kind for kind in known}

    def persistent_load(self, pid: int) -> object:
        """The shared object of a number."""
        return self._shared[pid]

    def find_class(self, module: str, name: str) -> Any:
        """The class of that name, if it may be read."""
        if (module, name) in self._known:
            return self._known[module, name]
        if module.partition(".")[0] == "numpy" and name in _ARRAYS:
            return super().find_class(module, name)
        if module.startswith(self._ours) and "." not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and dataclasses.is_dataclass(found):
                return found
        raise pickle.UnpicklingError(f"`{module}.{name}` does not belong there")
