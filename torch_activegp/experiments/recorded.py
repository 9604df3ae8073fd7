"""The recordings that a user names: loaded, checked against the model, kept apart from those held out."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from torch_activegp.data import (
    ColumnMap,
    Recording,
    estimate_velocities,
    known_recordings,
    load_recordings,
    unwrap_angles,
)
from torch_activegp.data.checks import MIN_ROWS
from torch_activegp.errors import DataError
from torch_activegp.simulators import Simulator

_KNOWN = re.compile(r"\w{2,}:\w*")  # one letter is a drive of Windows
HELD_OUT = ("test", "holdout")
"""How the names of recordings that are held out begin."""
_SHARE_HELD_OUT = 5


def load_named(words: Sequence[str], columns: ColumnMap | Path | None = None) -> list[Recording]:
    """Load what a user names on the command line.

    Args:
        words: files or patterns (:func:`~torch_activegp.data.load_recordings`), or public data such as ``emps:train``
            (:func:`~torch_activegp.data.known_names`).
        columns: a column map for the files, or its path.

    Returns:
        All runs, in the order of the words.

    Raises:
        DataError: there is no such file or data set, a file is no recording, or a run comes twice.
    """
    columns = ColumnMap.from_toml(columns) if isinstance(columns, Path) else columns
    recordings: list[Recording] = []
    for word in words:
        known = _KNOWN.fullmatch(word) and not Path(word).exists()
        recordings += known_recordings(word) if known else load_recordings(word, columns)
    found = Counter((recording.source and recording.source.resolve(), recording.label) for recording in recordings)
    for (_, label), count in found.items():
        if count > 1:
            raise DataError(f"{label} is given {count} times, and would count for as many runs. Name it once.")
    return recordings


def load_apart(
    words: Sequence[str], holdout: Sequence[str], columns: ColumnMap | Path | None = None
) -> tuple[list[Recording], list[Recording]]:
    """Load what a user names to learn from, and what to hold out.

    Raises:
        DataError: as :func:`load_named`, and where something is both learned from and held out.
    """
    for word in holdout:
        if word in words:
            raise _not_apart(word)
    recordings, held_out = load_named(words, columns), load_named(holdout, columns)
    check_apart(recordings, held_out)
    return recordings, held_out


def fitted_by_mistake(words: Sequence[str], holdout: Sequence[str]) -> str | None:
    """A sentence where something is fitted whose name says that it is held out, beside what is; else None.

    A shell spreads `--holdout test*.csv` over several words, of which the option takes the first.
    """
    names = [word for word in words if Path(word).name.lower().startswith(HELD_OUT)]
    if not names or not any(Path(word).name.lower().startswith(HELD_OUT) for word in holdout):
        return None
    return (
        f"{', '.join(names)}: fitted, not held out. If that is a mistake, quote the pattern, which a shell "
        "spreads over several words: --holdout 'test*.csv'."
    )


def set_aside(recordings: Sequence[Recording]) -> tuple[list[Recording], list[Recording], str]:
    """Set aside recordings that nothing is learned from: a fifth of the runs, or the last fifth of a single run.

    Returns:
        What to learn from, what is held out, and a sentence that says which.

    Raises:
        DataError: a single run is too short.
    """
    if len(recordings) > 1:
        count = max(1, round(len(recordings) / _SHARE_HELD_OUT))
        held_out = list(recordings[-count:])
        names = ", ".join(recording.label for recording in held_out)
        return list(recordings[:-count]), held_out, f"Held out: {names} ({count} of {len(recordings)} runs)."
    (run,) = recordings
    cut = len(run) - len(run) // _SHARE_HELD_OUT
    if len(run) - cut < MIN_ROWS:
        raise DataError(f"{run.label}: too short, {len(run)} rows, to hold a fifth of them out. Record longer.")
    first, last = from_row(run, 0, cut), from_row(run, cut)
    return [first], [last], f"Held out: the last fifth of {run.label}, rows {cut + 1} to {len(run)}."


def check_apart(recordings: Sequence[Recording], holdout: Sequence[Recording]) -> None:
    """Check that no file is both learned from and held out.

    Raises:
        DataError: naming the file.
    """
    sources = {recording.source.resolve() for recording in recordings if recording.source is not None}
    for recording in holdout:
        if recording.source is not None and recording.source.resolve() in sources:
            raise _not_apart(recording.name)


def _not_apart(name: str) -> DataError:
    return DataError(
        f"{name} is both learned from and held out, so its errors would say nothing. Hold another recording out, or "
        "leave --holdout out: a part is then set aside."
    )


def check_columns_known(recordings: Sequence[Recording], simulator: Simulator, name: str) -> None:
    """Check that a model has every joint and actuator that was recorded, and the recording those of the model.

    Raises:
        DataError: naming the file and the column, and what is there instead; or a joint is prescribed.
    """
    states, actions = simulator.state_space.names, simulator.action_space.names
    wanted = [column for column in (*states, *actions) if column.startswith(("qpos.", "ctrl."))]
    for recording in recordings:
        if recording.prescribed:
            raise DataError(
                f"{recording.label}: `{recording.prescribed[0]}` is said to be prescribed, and a model that is learned "
                "explains every joint. Leave `prescribed` out of the column map, or diagnose."
            )
        strange = [column for column in recording.columns[1:] if column not in (*states, *actions)]
        if strange:
            raise DataError(
                f"{recording.label}: `{name}` has no {', '.join(strange)}; it has {', '.join((*states, *actions))}. "
                "Rename the columns with a column map (--columns MAP.toml), or take the model of this machine."
            )
        missing = [column for column in wanted if column not in recording]
        if missing:
            raise DataError(
                f"{recording.label}: no column {', '.join(missing)}, which `{name}` wants; found "
                f"{', '.join(recording.columns)}. Record it, or map it with a column map (--columns MAP.toml)."
            )


def with_velocities(recording: Recording, simulator: Simulator) -> Recording:
    """Take the leaps out of recorded angles, and estimate the velocities that were not recorded."""
    names = simulator.state_space.names
    turning = [names[index].removeprefix("qpos.") for index in simulator.state_space.angles]
    return estimate_velocities(unwrap_angles(recording, [joint for joint in turning if f"qpos.{joint}" in recording]))


def from_row(recording: Recording, start: int, stop: int | None = None) -> Recording:
    """A part of a run."""
    columns = {name: recording[name][start:stop] for name in recording.columns}
    return Recording.from_columns(
        recording.name, columns, run=recording.run, source=recording.source, notes=recording.notes
    )
