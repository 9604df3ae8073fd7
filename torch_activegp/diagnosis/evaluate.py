"""How well a simulator forecasts recordings as it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco

from torch_activegp.data import Recording
from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.inputs.blackbox import check_clock, check_recordings
from torch_activegp.diagnosis.inputs.machine import check_given, recording_notes
from torch_activegp.diagnosis.inputs.runs import Channels, make_run
from torch_activegp.diagnosis.inputs.source import read_source
from torch_activegp.diagnosis.inputs.wrong_units import check_units
from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.engine import NOMINAL, Engine, substeps_for
from torch_activegp.diagnosis.simulation.forms import begin_drives
from torch_activegp.errors import DataError


def evaluate(model: object, recordings: Sequence[Recording], nthread: int = 0) -> dict[str, Any]:
    """Says how far a simulator's forecasts are from recordings; no parameter is fitted.

    Errors are root mean squares over the recorded positions in units of the standard deviation of what was measured.

    Args:
        model: what :func:`~torch_activegp.diagnosis.diagnose` takes.
        recordings: runs to forecast.
        nthread: threads of the simulations; 0 for all cores.

    Returns:
        ``one_step`` (0.1 s ahead of what was shown) and ``free_run`` (a whole run from a fitted initial state),
        each with the ``error`` and what ``noise`` alone would leave; ``runs``, the same for each run and channel; and
        ``notes``, what was decided about the recordings, in sentences.

    Raises:
        DataError: no recordings, or one that does not fit the model or seems to be in another unit.
        ConfigurationError: a model that does not compile or cannot be simulated in batches.
    """
    recordings = check_given(recordings, "evaluate")
    if not recordings:
        raise DataError("evaluate: no recordings found, at least one wanted.")
    source = read_source(model)
    channels = Channels.of(source.model, recordings)
    runs = [make_run(recording, source.model, channels) for recording in recordings]
    if source.box is None:
        doubts = check_units(source.model, channels, runs)
        engine = Engine(source.model, channels, substeps_for(source.model, runs), nthread)
        begin_drives([engine], runs)
    else:
        doubts = []
        check_recordings(source.box, recordings)
        engine = BlackBoxEngine(source.box, channels, check_clock(source.box, runs))
    noise = noise_floor(runs)
    errors, _ = compare({"error": (engine, NOMINAL)}, runs, channels.joints, noise)
    left_out = [f"{run.label}: {note}" for run in runs for note in run.notes]
    notes = [*doubts, *left_out, *_notes(source.model, channels, recordings)]
    return {**{key: errors[key] for key in ("runs", "one_step", "free_run")}, "notes": notes}


def _notes(model: mujoco.MjModel, channels: Channels, recordings: Sequence[Recording]) -> list[str]:
    """What was decided about the recordings."""
    notes = []
    if channels.prescribed is not None:
        joints = ", ".join(channels.prescribed.joints)
        notes.append(f"Prescribed: {joints}. Simulations follow the recorded motion there; it is not scored.")
    return [*notes, *recording_notes(model, recordings)]
