"""How well a simulator forecasts recordings: one step ahead, over windows, and free from the first state on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from tensordict import TensorDict
from torch import Tensor

from torch_activegp.keys import ACTION, STATE
from torch_activegp.simulators import Simulator

KINDS = ("one_step", "window", "free_run")
"""The forecasts: each step from its recorded state; windows from theirs; the whole run from its first state."""


@dataclass(frozen=True)
class Errors:
    """Errors of one kind of forecast; infinite where a forecast diverged.

    Attributes:
        rmse: root mean square error by name of the state, in its unit.
        nrmse: the same in standard deviations of the recorded signal.
        position_nrmse: root mean square of ``nrmse`` over the positions: the one number.
        diverged_after: when the first forecast ceased to be finite, s after its start; None if none did.
    """

    rmse: dict[str, float]
    nrmse: dict[str, float]
    position_nrmse: float
    diverged_after: float | None = None


@dataclass(frozen=True)
class Forecast:
    """Errors of a simulator on recordings.

    Attributes:
        one_step: from each recorded state to the next.
        window: over consecutive windows, each from the recorded state at its start.
        free_run: over whole runs, from the first state of each.
        free_states: what the free runs gave, ``(T, d)`` for each run.
        window_states: what the windows gave, ``(windows, length, d)`` for each run; a shorter rest is left out.
    """

    one_step: Errors
    window: Errors
    free_run: Errors
    free_states: tuple[Tensor, ...]
    window_states: tuple[Tensor, ...]


@torch.no_grad()
def forecast(simulator: Simulator, runs: Sequence[TensorDict], window: float, scale: Tensor | None = None) -> Forecast:
    """Forecast recorded runs with the recorded controls.

    Args:
        simulator: the model.
        runs: transitions of one run each, in order (:func:`~torch_activegp.data.to_transitions`).
        window: length of the windows, s; at most that of the run.
        scale: unit of normalised errors, ``(d,)``; default :func:`signal_scale` of the runs.

    Returns:
        The errors of all runs together.

    Example:
        >>> from torch_activegp.simulators import Pendulum
        >>> state, action = torch.zeros(3, 2), torch.zeros(3, 1)
        >>> run = TensorDict({"state": state, "action": action, "next": {"state": state}}, [3])
        >>> forecast(Pendulum(equation="paper"), [run], window=0.1).free_run.position_nrmse
        0.0
    """
    scale = signal_scale(simulator, [run["next", STATE] for run in runs]) if scale is None else scale
    lengths = [max(1, min(len(run), round(window / simulator.dt))) for run in runs]
    steps, _ = window_errors(simulator, [_cut(run, 1) for run in runs], scale)
    windows, window_states = window_errors(simulator, list(map(_cut, runs, lengths)), scale)
    free, free_states = window_errors(simulator, [_cut(run, len(run)) for run in runs], scale)
    return Forecast(steps, windows, free, tuple(states.squeeze(0) for states in free_states), window_states)


@torch.no_grad()
def window_errors(
    simulator: Simulator, windows: Sequence[TensorDict], scale: Tensor
) -> tuple[Errors, tuple[Tensor, ...]]:
    """Forecast windows from the recorded state at the start of each, with the recorded controls.

    Args:
        simulator: the model.
        windows: transitions in order, ``(number of windows, length)``; all enter the errors together.
        scale: unit of normalised errors, ``(d,)``.

    Returns:
        The errors, and the predicted states, ``(number of windows, length, d)`` each.
    """
    predicted = [simulator.rollout(part[STATE][:, 0], part[ACTION]) for part in windows]
    space, names = simulator.state_space, simulator.state_space.names
    errors = [space.difference(states, part["next", STATE]) for states, part in zip(predicted, windows, strict=True)]
    rmse = torch.cat([error.flatten(0, 1) for error in errors]).square().mean(0).sqrt()
    rmse = rmse.nan_to_num(math.inf, math.inf)
    nrmse = rmse / scale
    bad = [index for error in errors for index in (~error.isfinite().all(-1)).nonzero()[:, 1].tolist()]
    summary = Errors(
        rmse=dict(zip(names, rmse.tolist(), strict=True)),
        nrmse=dict(zip(names, nrmse.tolist(), strict=True)),
        position_nrmse=float(nrmse[positions_of(simulator)].square().mean().sqrt()),
        diverged_after=(min(bad) + 1) * simulator.dt if bad else None,
    )
    return summary, tuple(predicted)


def _cut(run: TensorDict, length: int) -> TensorDict:
    """Consecutive windows of a run, ``(number of windows, length)``; a rest that is shorter is left out."""
    count = len(run) // length
    return run[: count * length].reshape(count, length)


def positions_of(simulator: Simulator) -> list[int]:
    """Indices of the states that are positions; of all states where none is called ``qpos.<joint>``."""
    names = simulator.state_space.names
    return [index for index, name in enumerate(names) if name.startswith("qpos.")] or list(range(len(names)))


def signal_scale(simulator: Simulator, states: Sequence[Tensor]) -> Tensor:
    """Standard deviation of each recorded state, the unit of normalised errors.

    Args:
        simulator: says which states are angles.
        states: ``(T, d)`` for each run.

    Returns:
        ``(d,)``; an angle's is that of its way along the line, at most that of the whole circle (pi / sqrt(3)); a state
        that is constant has 1.
    """
    space = simulator.state_space
    unrolled = []
    for run in states:
        turns = space.difference(run[1:], run[:-1]).cumsum(0)
        unrolled.append(torch.cat([run[:1], run[:1] + turns]))
    scale = torch.cat(unrolled).std(0)
    limit = torch.full_like(scale, math.inf)
    limit[list(space.angles)] = math.pi / math.sqrt(3.0)
    return torch.where(scale > 0, torch.minimum(scale, limit), torch.ones_like(scale))
