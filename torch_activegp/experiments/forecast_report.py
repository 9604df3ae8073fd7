"""What learning from recordings writes: the errors as plain values, and the forecasts as a table."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from torch_activegp.experiments.forecast import KINDS, Errors, Forecast, positions_of
from torch_activegp.experiments.learn import WINDOW, Learned
from torch_activegp.keys import STATE


def summary(outcome: Learned) -> dict[str, Any]:
    """Everything that is known about a learned model, as values that JSON can hold.

    ``fit`` has the shape of the diagnosis: root mean square over the recorded positions in standard deviations of the
    signal, ``before`` for the simulator alone, ``after`` for simulator + GP, ``noise`` for the measurement. ``errors``
    has every state, in its unit and in standard deviations. None stands for a forecast that diverged.

    Args:
        outcome: from :func:`~torch_activegp.experiments.learn.learn`.

    Returns:
        Nested dicts.
    """
    pairs = {kind: (getattr(outcome.before, kind), getattr(outcome.after, kind)) for kind in KINDS}
    fit = {
        kind: {
            "before": _plain(before.position_nrmse),
            "after": _plain(after.position_nrmse),
            "noise": _plain(outcome.noise),
        }
        for kind, (before, after) in pairs.items()
    }
    trust = outcome.learned.trust
    return {
        "held_out": list(outcome.labels),
        "dt": outcome.simulator.dt,
        "window": WINDOW,
        "num_points": outcome.learned.gp.num_points,
        "fit": {"holdout": fit},
        "errors": {
            kind: {"simulator": _errors(before), "simulator_and_gp": _errors(after)}
            for kind, (before, after) in pairs.items()
        },
        "guard": {
            "stepped_in": bool((trust < 1).any()),
            "trust": dict(zip(outcome.guard.names, trust.tolist(), strict=True)),
            "one_step": str(outcome.guard),
            "windows": outcome.window_guard,
        },
        "relative_noise": outcome.fit.noise,
        "notes": list(outcome.notes),
    }


def _errors(errors: Errors) -> dict[str, Any]:
    return {
        "rmse": {name: _plain(value) for name, value in errors.rmse.items()},
        "nrmse": {name: _plain(value) for name, value in errors.nrmse.items()},
        "diverged_after": errors.diverged_after,
    }


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None


def predictions(outcome: Learned) -> pd.DataFrame:
    """The free runs over the held-out recordings.

    Args:
        outcome: from :func:`~torch_activegp.experiments.learn.learn`.

    Returns:
        One row a time step: ``run``, ``time`` [s] from the start of the run, and for each position ``<name>.measured``,
        ``<name>.simulator`` and ``<name>.simulator_and_gp``; a predicted angle is the turn nearest to the measured one.
        Empty where a forecast diverged.
    """
    tables = []
    forecasts: dict[str, Forecast] = {"simulator": outcome.before, "simulator_and_gp": outcome.after}
    space = outcome.simulator.state_space
    for index, run in enumerate(outcome.runs):
        measured = run["next", STATE]
        table: dict[str, Any] = {"run": outcome.labels[index], "time": (run["time"] + outcome.simulator.dt).numpy()}
        for position in positions_of(outcome.simulator):
            name = space.names[position]
            table[f"{name}.measured"] = measured[:, position].numpy()
            for label, forecast in forecasts.items():
                states = space.unwrap(forecast.free_states[index], measured)
                table[f"{name}.{label}"] = states[:, position].numpy()
        tables.append(pd.DataFrame(table))
    return pd.concat(tables, ignore_index=True)
