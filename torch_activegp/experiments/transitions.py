"""From recordings to transitions of a simulator's states, at its step."""

from __future__ import annotations

import torch
from tensordict import TensorDict

from torch_activegp.data import Recording, resample
from torch_activegp.data.checks import MIN_ROWS
from torch_activegp.data.transitions import to_transitions
from torch_activegp.experiments.recorded import from_row
from torch_activegp.keys import ACTION, STATE
from torch_activegp.simulators import Simulator


def transitions_of(recording: Recording, simulator: Simulator, shifts: int = 1) -> TensorDict:
    """Transitions of one run at the simulator's step.

    Args:
        recording: with velocities, in time steps of at most ``simulator.dt``.
        simulator: says states, actions and step.
        shifts: how many clocks to use, each begun a little later within the first step, so that more rows are used.

    Returns:
        See :func:`~torch_activegp.data.to_transitions`; angles are wrapped, ``time`` begins at 0 with the run.

    Raises:
        DataError: the run is too short, its own step is too long, or a column is missing.
    """
    rows = max(1, round(simulator.dt / recording.dt))
    shifts = min(max(shifts, 1), rows)
    starts = [index * rows // shifts for index in range(shifts)]
    clocks = [from_row(recording, start) for start in starts if start == 0 or len(recording) - start > MIN_ROWS * rows]
    parts = [
        to_transitions(
            [resample(clock, simulator.dt)], simulator.state_space.names, simulator.action_space.names, simulator.dt
        )
        for clock in clocks
    ]
    data: TensorDict = torch.cat(parts)
    data["time"] = data["time"] - recording.time[0]
    for key in (STATE, ("next", STATE)):
        data[key] = simulator.state_space.wrap(data[key])
    data[ACTION] = data[ACTION].contiguous()
    return data
