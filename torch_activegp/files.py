"""Files that are whole or absent."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


@contextmanager
def written_whole(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, which takes the name ``path`` once all of it is on the disk.

    Until then it has a name of its own in the same folder. An error or Ctrl-C removes it and leaves the earlier file as
    it was; a kill or a power cut leaves the earlier file too.

    Args:
        path: where to write; its folder is there.

    Yields:
        The file, open to write bytes and to read them again.

    Raises:
        OSError: the disk or the folder cannot be written.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     with written_whole(Path(folder) / "notes.txt") as file:
        ...         _ = file.write(b"all of it")
        ...     os.listdir(folder)
        ['notes.txt']
    """
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
    try:
        with temporary.open("x+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        with suppress(OSError):
            temporary.unlink()
