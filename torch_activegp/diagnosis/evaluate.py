"""How well a simulator forecasts recordings as it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from torch_activegp.data import Recording
from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.inputs.blackbox import check_clock
from torch_activegp.diagnosis.inputs.held_out import that_can_be_forecast
from torch_activegp.diagnosis.inputs.machine import check_given, lay_over
from torch_activegp.diagnosis.inputs.runs import Channels, median_step
from torch_activegp.diagnosis.inputs.source import Source, read_source
from torch_activegp.diagnosis.inputs.wrong_columns import doubt_columns
from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.preparation.missing_rows import with_missing_controls
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine, substeps_for
from torch_activegp.diagnosis.simulation.forms import begin_drives
from torch_activegp.diagnosis.simulation.simulator import EffectSimulator
from torch_activegp.errors import DataError


@threadpool_limits.wrap(limits=1)  # as in `diagnose`
def evaluate(model: object, recordings: Sequence[Recording], nthread: int = 0) -> dict[str, Any]:
    """Says how far a simulator's forecasts are from recordings; no parameter is fitted.

    Errors are root mean squares over the recorded positions in units of the standard deviation of what was measured.

    Args:
        model: what :func:`~torch_activegp.diagnosis.diagnose` takes, or what it gives (``corrected``, ``learned``).
        recordings: runs to forecast.
        nthread: threads of the simulations; 0 for all cores.

    Returns:
        ``one_step`` (0.1 s ahead of what was shown) and ``free_run`` (a whole run from a fitted initial state),
        each with the ``error`` and what ``noise`` alone would leave; ``runs``, the same for each run and channel; and
        ``notes``, what was decided about the recordings, and controls whose unit or sign is doubted, in sentences.

    Raises:
        DataError: no recordings, or one that does not fit the model, does not move or seems to be in another unit.
        ConfigurationError: a model that does not compile or cannot be simulated in batches, or whose velocities are not
            the rates of its positions.
    """
    recordings = check_given(recordings, "evaluate")
    if not recordings:
        raise DataError("evaluate: no recordings found, at least one wanted.")
    effects = model if type(model) is EffectSimulator else None
    source = read_source(model) if effects is None else Source(effects.model, None, "", "")
    channels = Channels.of(source.model, recordings)
    (runs,), notes = lay_over(source.model, channels, [recordings], source.box)
    candidate = NOMINAL if effects is None else effects.candidate
    engine: Engine
    if source.box is None:
        doubts = doubt_columns(source.model, channels, recordings, runs)
        if effects is None:
            engine = Engine(source.model, channels, substeps_for(source.model, runs), nthread)
        else:
            engine = effects.engine_for(channels, median_step(runs), nthread)
        begin_drives([engine], runs)
    else:
        doubts = source.box.notes()
        engine = BlackBoxEngine(source.box, channels, check_clock(source.box, runs))
    noise = noise_floor(runs)
    runs, _, controls = with_missing_controls(runs, (), [engine], noise, candidate)
    runs, short = that_can_be_forecast(runs)
    errors, _ = compare({"error": (engine, candidate)}, runs, channels.joints, noise)
    told = {key: errors[key] for key in ("runs", "one_step", "free_run")}
    return {**told, "notes": list(dict.fromkeys([*notes, *doubts, *controls, *short]))}
