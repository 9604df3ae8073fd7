"""A guard over windows: a correction that helps at each step, and yet leads astray over many, is shrunk."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from tensordict import TensorDict
from torch import Tensor

from torch_activegp.experiments.forecast import window_errors
from torch_activegp.models import LearnedSimulator
from torch_activegp.simulators import Simulator

_FACTORS = (0.0, 0.25, 0.5)


def guard_windows(
    simulator: Simulator, learned: LearnedSimulator, windows: TensorDict, scale: Tensor
) -> tuple[LearnedSimulator, str]:
    """Compare simulator and learned model over windows that the model has not seen.

    A bias of each step that is far below its noise, for example from velocities that were estimated, adds up over a
    window. Where the whole correction forecasts the positions worse than the simulator alone, it is multiplied by the
    best of 0 (the simulator alone), 1/4 and 1/2.

    Args:
        simulator: the simulator alone.
        learned: simulator + GP.
        windows: transitions in order, ``(number of windows, length)``.
        scale: unit of the errors, ``(d,)``.

    Returns:
        The learned model, shrunk or not, and a sentence that says which.
    """
    alone = window_errors(simulator, [windows], scale)[0].position_nrmse
    whole = window_errors(learned, [windows], scale)[0].position_nrmse
    span = f"windows of {windows.shape[1] * simulator.dt:.3g} s that were not learned from"
    if whole <= alone:
        return learned, f"Over {span}, simulator + GP has an error of {whole:.3g}, the simulator alone {alone:.3g}."
    shrunk = [
        LearnedSimulator(learned.gp, learned.action_space, learned.dt, factor * learned.trust) for factor in _FACTORS
    ]
    errors = [window_errors(model, [windows], scale)[0].position_nrmse for model in shrunk]
    best = min(range(len(_FACTORS)), key=lambda index: errors[index])
    return shrunk[best], (
        f"The guard stepped in: over {span}, simulator + GP has an error of {whole:.3g}, the simulator alone "
        f"{alone:.3g}; {100 * _FACTORS[best]:.0f} % of the correction is kept ({errors[best]:.3g})."
    )


def cut_windows(runs: Sequence[TensorDict], rows: Sequence[Tensor]) -> TensorDict:
    """Equally long windows from the chosen rows of each run.

    Args:
        runs: transitions of one run each, in order.
        rows: which of them to use, ``(T,)`` of bool each.

    Returns:
        ``(number of windows, length)``, the length being that of the median uninterrupted piece, from which shorter
        pieces are left out and longer ones cut.
    """
    pieces: list[TensorDict] = []
    for run, chosen in zip(runs, rows, strict=True):
        index = chosen.nonzero().flatten()
        cuts = ((index.diff() > 1).nonzero().flatten() + 1).tolist()
        pieces += [run[part] for part in index.tensor_split(cuts) if len(part)]
    length = sorted(map(len, pieces))[math.floor((len(pieces) - 1) / 2)]
    windows: TensorDict = torch.stack([piece[:length] for piece in pieces if len(piece) >= length])
    return windows
