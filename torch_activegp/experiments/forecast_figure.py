"""The picture of a learned model: what was measured, and what simulator and simulator + GP forecast."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import mujoco
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from torch_activegp.experiments.forecast import Errors, positions_of
from torch_activegp.experiments.learn import WINDOW, Learned
from torch_activegp.experiments.picture import LOOK, save_picture
from torch_activegp.keys import STATE
from torch_activegp.simulators import MujocoSimulator

_MOST = 6
_MARGIN = 0.25
_STYLES: dict[str, dict[str, Any]] = {
    "measured": {"color": "black", "linewidth": 3.5, "alpha": 0.3},
    "simulator alone": {"color": "#D55E00", "linewidth": 1.2, "linestyle": "--"},
    "simulator + GP": {"color": "#0072B2", "linewidth": 1.2},
}


def draw_forecast(outcome: Learned, folder: Path) -> list[Path]:
    """Draw the first held-out run as ``forecast.png`` and ``forecast.svg``; the same bytes for the same outcome.

    One row for each position, the first six at most: on the left the free run, on the right the windows, each of which
    starts from what was measured. The axes keep to what was measured, and a forecast may leave them.

    Args:
        outcome: from :func:`~torch_activegp.experiments.learn.learn`.
        folder: where to write.

    Returns:
        The files.

    Raises:
        ConfigurationError: the folder cannot be written.
    """
    positions = positions_of(outcome.simulator)[:_MOST]
    with matplotlib.rc_context(LOOK):
        figure = Figure(figsize=(12, 1.4 + 2.6 * len(positions)), layout="constrained")
        rows = figure.subplots(len(positions), 2, squeeze=False, sharex=True)
        for index, (position, (left, right)) in enumerate(zip(positions, rows, strict=True)):
            title = f"Free run of {outcome.labels[0]}" if index == 0 else ""
            _draw(left, outcome, position, "free", title)
            _draw(right, outcome, position, "window", f"Windows of {WINDOW:g} s" if index == 0 else "")
            left.set_ylabel(f"{outcome.simulator.state_space.names[position]} [{_unit(outcome, position)}]")
        for axes in rows[-1]:
            axes.set_xlabel("time [s]")
        handles, labels = rows[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
        return save_picture(figure, folder / "forecast")


def _draw(axes: Axes, outcome: Learned, position: int, kind: str, title: str) -> None:
    run, space = outcome.runs[0], outcome.simulator.state_space
    measured, time = run["next", STATE], run["time"] + outcome.simulator.dt
    axes.plot(time, measured[:, position], label="measured", **_STYLES["measured"])
    for label, forecast in zip(list(_STYLES)[1:], (outcome.before, outcome.after), strict=True):
        pieces = forecast.free_states[0].unsqueeze(0) if kind == "free" else forecast.window_states[0]
        count, length = pieces.shape[:2]
        near = space.unwrap(pieces, measured[: count * length].reshape_as(pieces))[..., position]
        lines = axes.plot(time[: count * length].reshape(count, length).mT, near.mT, **_STYLES[label])
        lines[0].set_label(label)
    low, high = measured[:, position].aminmax()
    margin = _MARGIN * max(float(high - low), 1e-6)
    axes.set_ylim(float(low) - margin, float(high) + margin)
    if title:
        before, after = (_error(forecast, kind) for forecast in (outcome.before, outcome.after))
        title = f"{title}: NRMSE {_number(before)} alone, {_number(after)} with GP"
        axes.set_title(title, fontsize=10)


def _error(forecast: Any, kind: str) -> Errors:
    return forecast.free_run if kind == "free" else forecast.window


def _number(errors: Errors) -> str:
    return "diverged" if errors.diverged_after is not None else f"{errors.position_nrmse:.3g}"


def _unit(outcome: Learned, position: int) -> str:
    space, simulator = outcome.simulator.state_space, outcome.simulator
    if position in space.angles or not isinstance(simulator, MujocoSimulator):
        return "rad" if position in space.angles else "SI"
    kinds = {f"qpos.{joint.name}": joint.type for joint in map(simulator.model.joint, range(simulator.model.njnt))}
    return "rad" if kinds.get(space.names[position]) == mujoco.mjtJoint.mjJNT_HINGE else "m"
