"""From recordings to one-step transitions, the data that a dynamics model learns from."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict import TensorDict
from torch import Tensor

from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError
from torch_activegp.keys import ACTION, STATE

_TOLERANCE = 0.01


def to_transitions(
    recordings: Sequence[Recording], state_names: Sequence[str], action_names: Sequence[str], dt: float | None = None
) -> TensorDict:
    """Pair each row with the next one of the same run.

    Args:
        recordings: runs; no transition leads from one to another.
        state_names: canonical columns that form the state, in the model's order, such as ``qpos.elbow``.
        action_names: canonical columns that form the action: ``ctrl.<actuator>``, ``qfrc.<joint>``. A force that was
            not recorded is zero.
        dt: the model's time step, s; every step of the recordings must then agree to 1 %.

    Returns:
        TensorDict of batch ``(N,)``, float64: ``state`` ``(N, d)``, ``action`` ``(N, m)``, ``("next", "state")``
        ``(N, d)``, ``time`` ``(N,)`` s, and ``run`` ``(N,)``, the index of the recording.

    Raises:
        DataError: if there is no recording, a column is missing, or a time step differs from ``dt``.

    >>> columns = {"time": [0.0, 0.1, 0.2, 0.3], "qpos.x": [1.0, 2.0, 3.0, 4.0], "ctrl.u": [5.0, 6.0, 7.0, 8.0]}
    >>> data = to_transitions([Recording.from_columns("run", columns)], ["qpos.x"], ["ctrl.u"])
    >>> data["state"].tolist(), data["action"].tolist(), data["next", "state"].tolist()
    ([[1.0], [2.0], [3.0]], [[5.0], [6.0], [7.0]], [[2.0], [3.0], [4.0]])
    """
    if not recordings:
        raise DataError("no recording to take transitions from. Load at least one.")
    return torch.cat([_pair(run, recording, state_names, action_names, dt) for run, recording in enumerate(recordings)])


def _pair(
    run: int, recording: Recording, state_names: Sequence[str], action_names: Sequence[str], dt: float | None
) -> TensorDict:
    steps = torch.diff(recording.time)
    if dt is not None:
        off = torch.nonzero(torch.abs(steps - dt) > _TOLERANCE * dt).flatten()
        if len(off):
            raise DataError(
                f"{recording.label}: a step of {dt:.6g} s wanted, found {float(steps[off[0]]):.6g} s after "
                f"{float(recording.time[off[0]]):.6g} s. "
                f"Bring it to the model's step with `resample(recording, {dt:.6g})`."
            )
    state = torch.stack([_column(recording, name) for name in state_names], dim=-1)
    actions = [_column(recording, name) for name in action_names]
    action = torch.stack(actions, dim=-1) if actions else state.new_zeros(len(recording), 0)
    return TensorDict(
        {
            STATE: state[:-1],
            ACTION: action[:-1],
            ("next", STATE): state[1:],
            "time": recording.time[:-1],
            "run": torch.full((len(recording) - 1,), run),
        },
        batch_size=[len(recording) - 1],
    )


def _column(recording: Recording, name: str) -> Tensor:
    if name in recording:
        return recording[name]
    if name.startswith("qfrc."):
        return torch.zeros_like(recording.time)
    advice = (
        "Estimate it with `estimate_velocities`." if name.startswith("qvel.") else "Record it, or rename it in the map."
    )
    raise DataError(
        f"{recording.label}: the model wants `{name}`, the recording holds {', '.join(recording.columns)}. {advice}"
    )
