"""The recordings' neighbourhood of a fit as a linear time-varying system: one simulation serves every force law."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import Candidate


@dataclasses.dataclass(frozen=True)
class Linearization:
    """dx' = A dx + B f + D du around the trajectories of a fit, from row to row.

    Args:
        states: the trajectories, ``(S, K + 1, n)``.
        transition: A, ``(S, K, n, n)``.
        force: B, for a force on each recorded joint held over the interval, ``(S, K, n, C)``.
        control: D, for each control, ``(S, K, n, nu)``.
        positions: which states are the recorded positions, ``(C,)``.
        velocities: which are their velocities, ``(C,)``.
    """

    states: Array
    transition: Array
    force: Array
    control: Array
    positions: NDArray[np.int64]
    velocities: NDArray[np.int64]

    def pick(self, which: NDArray[np.int64]) -> Linearization:
        """The same around some of the segments."""
        names = ("states", "transition", "force", "control")
        return dataclasses.replace(self, **{name: getattr(self, name)[which] for name in names})

    def respond(self, inputs: Array) -> Array:
        """Changes of the recorded positions by inputs ``(S, K, n, A)`` to the states: ``(S, K + 1, C, A)``."""
        size, intervals, n, count = inputs.shape
        out = np.zeros((size, intervals + 1, len(self.positions), count))
        state = np.zeros((size, n, count))
        for k in range(intervals):
            state = self.transition[:, k] @ state + inputs[:, k]
            out[:, k + 1] = state[:, self.positions]
        return out

    def respond_to_force(self, channel: int, force: Array) -> Array:
        """Changes of the recorded positions by forces ``(S, K, A)`` on one recorded joint."""
        return self.respond(self.force[:, :, :, channel, None] * force[:, :, None, :])

    def pull(self, gradient: Array) -> Array:
        """The gradient by a force on each recorded joint, held over each interval, ``(S, K, C)``.

        The transpose of :meth:`respond_to_force`: one pass backwards in time serves all laws at once.

        Args:
            gradient: by the recorded positions, ``(S, K + 1, C)``.
        """
        size, intervals, n, _ = self.transition.shape
        out = np.zeros((size, intervals, self.force.shape[-1]))
        costate = np.zeros((size, n))
        for k in range(intervals - 1, -1, -1):
            costate[:, self.positions] += gradient[:, k + 1]
            out[:, k] = np.einsum("snc,sn->sc", self.force[:, k], costate)
            costate = np.einsum("snm,sn->sm", self.transition[:, k], costate)
        return out

    def respond_to_start(self) -> Array:
        """Derivatives of the recorded positions by the initial states, ``(S, K + 1, C, n)``."""
        size, intervals, n, _ = self.transition.shape
        state = np.broadcast_to(np.eye(n), (size, n, n))
        out = np.zeros((size, intervals + 1, len(self.positions), n))
        out[:, 0] = state[:, self.positions]
        for k in range(intervals):
            state = self.transition[:, k] @ state
            out[:, k + 1] = state[:, self.positions]
        return out


@functools.lru_cache(maxsize=2)
def linearize(shooting: Shooting, fit: Fit) -> Linearization:
    """Finite differences over single intervals, all of them side by side.

    Around the trajectories of the fit, and where these are far from the recording, around the smoothed recording: what
    a law does depends on where the machine was. The last two are kept: testing, judging and locating ask for the same.
    """
    engine, segments = shooting.differences, shooting.segments
    model, channels = engine.model, engine.channels
    states = engine.trajectories(segments, fit.starts, fit.candidate)
    far = segments.far_off(fit.per_segment)
    if far.any():
        there, rows, every = segments.pick(far), np.flatnonzero(far), np.arange(states.shape[1])
        states[np.ix_(rows, every, channels.qpos)] = there.take("smooth")
        states[np.ix_(rows, every, model.nq + channels.dof)] = there.take("velocity")
    size, intervals = segments.size, segments.intervals
    pieces = _single(segments)
    begin = states[:, :-1].reshape(size * intervals, -1)
    n = begin.shape[1]
    steps = shooting.state_columns(fit.starts)
    pushes, forces = [], []
    for dof in channels.dof:
        strength = 0.02 / max(float(model.dof_invweight0[dof]), 1e-12)
        push = np.zeros((size * intervals, 1, model.nv))
        push[:, 0, dof] = strength
        pushes.append(dataclasses.replace(fit.candidate, force=push))
        forces.append(strength)
    shoves, controls = [], []
    for index in range(model.nu):
        strength = 0.02 * max(float(np.abs(segments.take("control")[..., index]).max()), 1e-3)
        shove = np.zeros((size * intervals, 1, model.nu))
        shove[:, 0, index] = strength
        shoves.append(dataclasses.replace(fit.candidate, shove=shove))
        controls.append(strength)
    candidates: list[Candidate] = [fit.candidate] * (1 + n) + pushes + shoves
    starts = np.repeat(begin[None], len(candidates), axis=0)
    starts[1 : 1 + n] += np.eye(n)[:, None, :] * steps
    ends = np.stack([engine.trajectories(pieces, s, c)[:, 1] for s, c in zip(starts, candidates, strict=True)])
    scales = np.concatenate([steps, forces, controls])
    moved = np.nan_to_num((ends[1:] - ends[0]) / scales[:, None, None]).reshape(len(scales), size, intervals, n)
    moved = np.moveaxis(moved, 0, -1)
    c = len(forces)
    return Linearization(
        states,
        moved[..., :n],
        moved[..., n : n + c],
        moved[..., n + c :],
        channels.qpos,
        model.nq + channels.dof,
    )


def _single(segments: Segments) -> Segments:
    """Every interval of every segment as a segment of its own."""
    size, intervals = segments.size, segments.intervals
    last = np.array([len(segments.runs[r]) - 2 for r in segments.run])
    first = np.minimum(segments.first[:, None] + np.arange(intervals), last[:, None])
    return Segments(
        segments.runs,
        np.repeat(segments.run, intervals),
        first.ravel(),
        np.zeros((size * intervals, 2, segments.position.shape[-1])),
        np.zeros((size * intervals, 2), dtype=bool),
        segments.dt.reshape(-1, 1),
        np.stack([first.ravel(), first.ravel() + 1], axis=1),
    )
