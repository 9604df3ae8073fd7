"""From a word on the command line to a simulator."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from torch_activegp.data.known_sets import KNOWN_MODELS, known_model
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import Simulator, load_simulator
from torch_activegp.simulators.load import is_factory
from torch_activegp.simulators.mujoco_model import load_model

_SHOWN = 5
_OTHERS = f"package.module:factory, or one of {', '.join(KNOWN_MODELS)}"
SAVED = ".pt"
"""How the names of simulators end that a diagnosis saved."""


def find_model(word: str) -> Path | Simulator:
    """The simulator that a user wants diagnosed.

    Args:
        word: an MJCF file, ``package.module:factory``, the name of a public data set, for its nominal model, or a
            simulator that a diagnosis saved (``corrected.pt``, ``learned.pt``).

    Returns:
        The path of a file that compiles, or the factory's or the saved simulator.

    Raises:
        ConfigurationError: there is no such model, or it cannot be made.
    """
    if is_factory(word):
        return load_simulator(word)
    path = Path(known_model(word) if word in KNOWN_MODELS else word)
    if path.is_dir():
        files = [file for file in sorted(path.iterdir()) if file.suffix in (".xml", SAVED) and file.is_file()]
        some = [*map(str, files[:_SHOWN]), *(["..."] if len(files) > _SHOWN else [])]
        has = f"Give one of {', '.join(some)}." if files else f"Give an MJCF file, {_OTHERS}."
        raise ConfigurationError(f"Wanted a model, found the folder {word!r}. {has}")
    if path.suffix == SAVED and not path.is_file():
        raise ConfigurationError(
            f"Wanted a simulator that a diagnosis saved, found no file {word!r} (working folder: {Path.cwd()}). Where "
            "corrected.xml holds all that was named, there is no corrected.pt: give that."
        )
    if not path.is_file():
        raise ConfigurationError(
            f"Unknown model {word!r}{guess(word, KNOWN_MODELS)} Wanted an MJCF file (none is there; working folder: "
            f"{Path.cwd()}), {_OTHERS}."
        )
    if path.suffix == SAVED:
        from torch_activegp.diagnosis import load_corrected

        return load_corrected(path)
    load_model(path)
    return path


def guess(word: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown word: the known word that is near, if there is one, and a full stop.

    Example:
        >>> guess("lass", ["emps", "laas"])
        ": did you mean 'laas'?"
    """
    close = get_close_matches(word, known, n=1)
    return f": did you mean {close[0]!r}?" if close else "."
