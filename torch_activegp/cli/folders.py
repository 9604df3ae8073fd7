"""Where results go, so that no earlier result is lost."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.output import check_output


def next_free(folder: Path, goes_on: Callable[[Path], bool] = lambda _: False) -> Path:
    """The folder, or with ``-2``, ``-3``, ... behind its name the first that is not there yet, or goes on."""
    names = itertools.chain([folder], (folder.with_name(f"{folder.name}-{number}") for number in itertools.count(2)))
    return next(path for path in names if goes_on(path) or not path.exists())


def check_free(folder: Path, patterns: Sequence[str], one_file: bool = False) -> None:
    """Check that results can be written to a folder, new or not, where none of an earlier run are.

    Args:
        folder: where to write.
        patterns: of the names of the results.
        one_file: whether `--out` names a file.

    Raises:
        ConfigurationError: an earlier result is there, the folder is a file, or it cannot be written.
    """
    if not folder.is_dir():
        check_output(folder, {}, resume=False)
        return
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigurationError(f"{folder} cannot be written. Choose another --out, or mend its permissions.")
    found = sorted(path.name for pattern in patterns for path in folder.glob(pattern))
    if found:
        there = f"{folder} holds earlier results ({', '.join(found)}), which are never overwritten."
        if one_file:
            there = f"{folder / found[0]} is there already, and no file is ever overwritten."
        raise ConfigurationError(f"{there} Choose another --out.")


@contextmanager
def results_in(folder: Path) -> Iterator[None]:
    """Make a folder and those above it, and write results there.

    Raises:
        ConfigurationError: that cannot be done.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise ConfigurationError(
            f"Cannot write to {folder}: {error.strerror or error}. Choose another --out, or mend its permissions or "
            "the disk."
        ) from error
