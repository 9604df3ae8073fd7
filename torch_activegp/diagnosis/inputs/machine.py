"""What a diagnosis starts from: the nominal model, the runs to fit, the runs that are set aside."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.blackbox import BlackBox, check_clock, check_rates, check_recordings
from torch_activegp.diagnosis.inputs.clock import truer_times
from torch_activegp.diagnosis.inputs.held_out import set_aside, that_can_be_forecast
from torch_activegp.diagnosis.inputs.not_recorded import partly_driven, undriven, unseen
from torch_activegp.diagnosis.inputs.own_filters import check_drives
from torch_activegp.diagnosis.inputs.runs import MIN_ROWS, Channels, Run, make_run
from torch_activegp.diagnosis.inputs.wrong_columns import doubt_columns
from torch_activegp.diagnosis.inputs.wrong_limits import clipping_notes
from torch_activegp.diagnosis.inputs.wrong_signs import check_signs
from torch_activegp.errors import ConfigurationError, DataError

_MOVES = 1e-9
_SHORT = 2.0
"""Less than this in all is hardly an experiment, s."""


@dataclasses.dataclass(frozen=True)
class Machine:
    """A model with recordings laid over it.

    Args:
        model: compiled nominal model.
        channels: the recorded joints.
        fit: runs for fitting and selection.
        holdout: runs that are forecast, and choose no name.
        notes: what was decided about the recordings.
        doubts: those of them by which a column may be in another unit or of another sign.
        undriven: those by which all controls are missing.
        lacks: those by which some controls are missing, of drives that may have rested.
        box: the simulator that the model stands for, where that is not MuJoCo.
    """

    model: mujoco.MjModel
    channels: Channels
    fit: tuple[Run, ...]
    holdout: tuple[Run, ...]
    notes: tuple[str, ...]
    box: BlackBox | None = None
    doubts: tuple[str, ...] = ()
    undriven: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()


def check_given(recordings: Recording | Sequence[Recording], asked: str) -> list[Recording]:
    """One recording or several, as a list.

    Args:
        recordings: what was given.
        asked: the function that was, for the message.

    Raises:
        ConfigurationError: something else than recordings.
    """
    if isinstance(recordings, Recording):
        return [recordings]
    given: list[object] = [recordings] if isinstance(recordings, str | Path) else list(recordings)
    for one in given:
        if not isinstance(one, Recording):
            what = f"a path. Read it: load_recordings({str(one)!r})" if isinstance(one, str | Path) else repr(one)
            raise ConfigurationError(f"{asked}: recordings wanted, found {what}.")
    return [one for one in given if isinstance(one, Recording)]


def make_machine(
    model: mujoco.MjModel, recordings: Sequence[Recording], holdout: Sequence[Recording], box: BlackBox | None = None
) -> Machine:
    """Lays recordings over a model and sets runs aside where none is given for that.

    Args:
        model: compiled nominal model.
        recordings: runs for fitting and selection.
        holdout: runs that are forecast, and choose no name; without any, the last fifth of the runs is set aside, or of
            the longest run where there are fewer than 3.
        box: the simulator that the model stands for, where that is not MuJoCo.

    Raises:
        DataError: there is no recording, or one does not fit the model, is too short, does not move, or seems to be in
            another unit.
        ConfigurationError: a black box moves its positions otherwise than its velocities say.
    """
    if not recordings:
        raise DataError("no recording to fit. Give at least one run of the machine.")
    channels = Channels.of(model, [*recordings, *holdout])
    (fit, kept), notes = lay_over(model, channels, (recordings, holdout), box)
    doubts, lacks = list[str](), list[str]()
    if box is None:
        doubts = doubt_columns(model, channels, [*recordings, *holdout], fit, kept)
        notes += clipping_notes(model, [*recordings, *holdout])
        check_signs(model, channels, fit)
        lacks = partly_driven(model, recordings)
    notes += doubts if box is None else box.notes()
    if kept:
        kept, more = that_can_be_forecast(kept)
        notes += more
    else:
        fit, kept, note = set_aside(fit)
        notes.append(note)
    seconds = sum(float(run.time[-1]) for run in fit)
    if seconds < _SHORT:
        notes.append(
            f"Only {seconds:.3g} s are fitted: what is missing shows there only if it is gross. Record several seconds "
            "in which every joint moves to and fro."
        )
    return Machine(
        model=model,
        channels=channels,
        fit=tuple(fit),
        holdout=tuple(kept),
        notes=tuple(dict.fromkeys(notes)),
        box=box,
        doubts=tuple(doubts),
        undriven=tuple(undriven(model, recordings)),
        lacks=tuple(lacks),
    )


def lay_over(
    model: mujoco.MjModel, channels: Channels, lists: Sequence[Sequence[Recording]], box: BlackBox | None = None
) -> tuple[list[list[Run]], list[str]]:
    """Lays lists of recordings over a model, all on one clock, that of the fastest.

    Args:
        model: compiled nominal model.
        channels: the joints that all recordings hold.
        lists: of recordings; the joints move in those of the first one.
        box: the simulator that the model stands for, where that is not MuJoCo.

    Returns:
        The same lists of runs, and what was decided about the recordings.

    Raises:
        DataError: a recording is too short, does not move, seems to have its times in another unit, or does not lie on
            the clock of a black box.
        ConfigurationError: a black box moves its positions otherwise than its velocities say, or a drive keeps a state
            that no recording holds.
    """
    notes: list[str] = []
    lists = [_long_enough(recordings, notes) for recordings in lists]
    every, said = truer_times([recording for recordings in lists for recording in recordings], channels)
    notes += [said] if said else []
    if channels.prescribed is not None:
        notes.append(_prescribed(channels.prescribed))
    notes += unseen(model, channels)
    notes += recording_notes(model, every)
    clock = min(float(recording.time.diff().median()) for recording in every if len(recording) > 1)
    laid = [make_run(recording, model, channels, clock) for recording in every]
    rest = iter(laid)
    runs = [[next(rest) for _ in recordings] for recordings in lists]
    notes += [f"{run.label}: {note}" for run in laid for note in run.notes]
    _refuse_constant(runs[0], channels)
    check_drives(model, laid)
    if box is not None:
        check_recordings(box, every)
        check_clock(box, laid)
        check_rates(box, channels, runs[0])
    return runs, notes


def recording_notes(model: mujoco.MjModel, recordings: Sequence[Recording]) -> list[str]:
    """What was read from each recording and what it lacks, in sentences; what is so of several is said once."""
    whose: dict[str, list[str]] = {}
    told: set[tuple[Path | None, str]] = set()
    for recording in recordings:
        own = [note for note in recording.notes if recording.source is None or (recording.source, note) not in told]
        told |= {(recording.source, note) for note in own}  # once for all runs of a file
        unseen = [joint for joint in recording.joints if f"qpos.{joint}" not in recording]
        lacks = [f"qvel.{joint} without qpos.{joint}; {joint} counts as not measured. Record it." for joint in unseen]
        for note in (*own, *lacks):
            whose.setdefault(note, []).append(recording.label)
    notes = [
        f"{first}{f' and {len(others)} more' if others else ''}: {note}" for note, (first, *others) in whose.items()
    ]
    return [*notes, *partly_driven(model, recordings), *undriven(model, recordings)]


def _prescribed(joints: Channels) -> str:
    """What it means that joints are prescribed, in words."""
    return (
        f"Prescribed: {', '.join(joints.joints)}. Simulations follow the recorded motion there, which drives the other "
        "joints; it is not scored, and nothing is sought there."
    )


def _long_enough(recordings: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """Leaves out what a gap has cut off, where the rest of its file is long enough."""
    files = {recording.source for recording in recordings if len(recording) >= MIN_ROWS}
    kept = []
    for recording in recordings:
        if len(recording) >= MIN_ROWS or recording.source is None or recording.source not in files:
            kept.append(recording)
        else:
            notes += [f"{recording.label}: {note}" for note in recording.notes]
            notes.append(f"{recording.label}: left out, a part of {len(recording)} rows is too short.")
    return kept


def _refuse_constant(runs: Sequence[Run], channels: Channels) -> None:
    for c, joint in enumerate(channels.joints):
        if all(np.ptp(run.position[:, c]) <= _MOVES for run in runs):
            raise DataError(
                f"{runs[0].label}, column `qpos.{joint}`: the same value in every row of every run. A position that "
                "moves is wanted; check the sensor, or leave the column out."
            )
    if all(np.ptp(run.smooth, axis=0).max() <= 4 * run.noise.max() for run in runs):
        raise DataError(
            f"{runs[0].label}: no excitation, every position stays within its noise. Record a motion of the machine."
        )
