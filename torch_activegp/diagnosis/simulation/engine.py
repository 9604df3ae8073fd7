"""Simulates many candidate models over many segments side by side."""

from __future__ import annotations

import copy
import logging
from collections.abc import Sequence
from typing import Self

import mujoco
import mujoco.batch
import numpy as np

from torch_activegp.diagnosis.inputs.control_limits import control_limits
from torch_activegp.diagnosis.inputs.own_filters import own_filters, without_filters
from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run, median_step
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.candidate import Candidate, grouped
from torch_activegp.diagnosis.simulation.controls import Controls, Inputs
from torch_activegp.diagnosis.simulation.explicit_damping import is_explicit
from torch_activegp.diagnosis.simulation.fields import Fields
from torch_activegp.diagnosis.simulation.hermite import fill_rows
from torch_activegp.diagnosis.simulation.leapfrog import halve_damping
from torch_activegp.diagnosis.simulation.memories import Memories
from torch_activegp.diagnosis.simulation.prescribed_motion import RUNGE_KUTTA, PrescribedMotion, make_heavy
from torch_activegp.diagnosis.simulation.readings import readings
from torch_activegp.diagnosis.simulation.stepping import Act, Hooks, Show, Stepping
from torch_activegp.errors import ConfigurationError
from torch_activegp.physics.effect import Effect, Index
from torch_activegp.simulators.mujoco_timers import without_timers
from torch_activegp.simulators.mujoco_warnings import warnings_to

_logger = logging.getLogger(__name__)
_MAX_ROWS = 6000
_FEW = 64
_MAX_BYTES = 60_000_000
_Disable = mujoco.mjtDisableBit
IMPLICIT_FAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


class Engine:
    """Runs a MuJoCo model with effects.

    Args:
        model: compiled nominal model; it is copied.
        channels: the recorded joints; those of them that are prescribed follow the runs.
        substeps: time steps in each interval between rows.
        nthread: threads; 0 for all cores.
        integrator: one of ``mujoco.mjtIntegrator`` in place of the model's own; filters of its drives then act exactly,
            and not as MuJoCo steps them.
        stride: rows in each time step, where rows come faster than the motion needs; takes one substep.
        late: controls and forces come half a time step later, and damping acts by the trapezoidal rule
            (:mod:`torch_activegp.diagnosis.simulation.leapfrog`). Semi-implicit Euler with a velocity that belongs to
            the middle between two positions is the leapfrog scheme, of second order, at one evaluation a step; half a
            step of the initial velocity is free anyhow where it is fitted, and half a step of the control is not.
        contacts: whether bodies may touch, the search for which takes a fifth of a small model's time.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        channels: Channels,
        substeps: int,
        nthread: int = 0,
        integrator: int | None = None,
        stride: int = 1,
        late: bool = False,
        contacts: bool = True,
    ) -> None:
        self.model, self.limits = copy.copy(model), control_limits(model)
        if late and integrator is not None:
            raise ConfigurationError("Engine: `late` is an integrator of its own; wanted no other one.")
        integrator = IMPLICIT_FAST if late else integrator
        off = int(_Disable.mjDSBL_CLAMPCTRL)  # runs hold what the limits let pass
        off |= int(_Disable.mjDSBL_SENSOR)  # readings come from the states
        self.model.opt.disableflags |= off if contacts else off | int(_Disable.mjDSBL_CONTACT)
        if integrator is not None:
            self.model.opt.integrator = integrator
        if channels.prescribed is not None:
            make_heavy(self.model, channels.prescribed)
        self.filters = own_filters(self.model)
        self._exact = integrator is not None
        if self._exact:
            without_filters(self.model, self.filters)
        self.channels = channels
        self.substeps = substeps
        self.nthread = nthread
        self.stride = stride if model.nq == model.nv else 1
        self.late = late
        self.work = 0.0
        """Time steps that it has computed, as :meth:`steps_in` counts them."""
        self._fields: dict[bool, Fields] = {}
        self._memories = Memories(channels)

    def without_leapfrog(self) -> Engine:
        """The same by Runge-Kutta where it is a leapfrog, which MuJoCo alone is not."""
        if not self.late:
            return self
        made = self._copy()
        made.model.opt.integrator, made.late = RUNGE_KUTTA, False
        return made

    def in_longer_steps(self, seconds: float, interval: float) -> Engine:
        """The same in steps of so long at least, or of whole intervals between rows, where it is Runge-Kutta's."""
        fewer = max(int(interval / seconds + 1e-6), 1)
        if self.model.opt.integrator != RUNGE_KUTTA or fewer >= self.substeps:
            return self
        made = self._copy()
        made.substeps = fewer
        return made

    def in_shorter_steps(self, times: int) -> Self:
        """The same in so many times as many steps."""
        made = self._copy()
        made.substeps *= times
        return made

    def _copy(self) -> Self:
        made = copy.copy(self)
        made.model, made._fields, made.work = copy.copy(self.model), {}, 0.0
        made._memories = Memories(self.channels)
        return made

    @property
    def state_size(self) -> int:
        """Positions and velocities: the free part of an initial state."""
        return int(self.model.nq + self.model.nv)

    @property
    def scheme(self) -> tuple[bool, int, bool]:
        """How it integrates, whatever the steps."""
        return self.late, int(self.model.opt.integrator), self.explicit

    @property
    def explicit(self) -> bool:
        """Whether it is semi-implicit Euler with damping at the speed that a step begins with."""
        return is_explicit(self.model)

    def steps_in(self, segments: Segments) -> float:
        """Time steps of one simulation of some segments, at most; those of Runge-Kutta count four times."""
        return float((-(-segments.lengths // self.stride)).sum()) * self._steps_in_a_row

    @property
    def _steps_in_a_row(self) -> int:
        return self.substeps * (4 if self.model.opt.integrator == RUNGE_KUTTA else 1)

    def starts(self, segments: Segments) -> Array:
        """First guess of the initial states from the smoothed recordings, ``(S, nq + nv)``."""
        model, channels = self.model, self.channels
        states = np.zeros((segments.size, self.state_size))
        states[:, : model.nq] = model.qpos0
        for s, (run, first) in enumerate(zip(segments.run, segments.first, strict=True)):
            states[s, channels.qpos] = segments.runs[run].smooth[first]
            states[s, model.nq + channels.dof] = segments.runs[run].velocity[first]
            given = segments.runs[run].prescribed
            if channels.prescribed is not None and given is not None:
                states[s, channels.prescribed.qpos] = given.smooth[first]
                states[s, model.nq + channels.prescribed.dof] = given.velocity[first]
        return states

    def predict(self, segments: Segments, starts: Array, candidates: Sequence[Candidate]) -> Array:
        """Simulates every candidate over every segment.

        Args:
            segments: S segments of K intervals.
            starts: initial states, ``(N, S, nq + nv)``, one set for each of the N candidates.
            candidates: N candidates.

        Returns:
            What the sensors would read, ``(N, S, K + 1, C)``; NaN in all of a segment whose simulation failed.
        """
        channels = self.channels
        memory = segments.size * (segments.intervals + 1) * self.state_size * 8
        per_call, read = max(min(_MAX_ROWS // segments.size, _MAX_BYTES // memory), 1), []
        for i in range(0, len(candidates), per_call):
            some = candidates[i : i + per_call]
            states = self._apart(segments, starts[i : i + per_call], some)
            position, velocity = states[..., channels.qpos], states[..., self.model.nq + channels.dof]
            read.append(readings(some, position, velocity, segments.dt))
        return np.concatenate(read)

    def controls(self, segments: Segments, candidate: Candidate) -> Array:
        """What reaches the machine behind the effects on the way, mean of each interval, ``(S, K, nu)``."""
        made = Controls(segments, [candidate], self.substeps, self.model.nu, self.filters if self._exact else ())
        steps = made(np.arange(segments.intervals * self.substeps))
        return np.asarray(steps.reshape(segments.size, segments.intervals, self.substeps, -1).mean(axis=2))

    def trajectories(self, segments: Segments, starts: Array, candidate: Candidate) -> Array:
        """All states of one candidate, ``(S, K + 1, nq + nv)``."""
        return self._apart(segments, starts[None], [candidate])[0]

    def _apart(self, segments: Segments, starts: Array, candidates: Sequence[Candidate]) -> Array:
        """All states ``(N, S, K + 1, nq + nv)``, the last ones of each segment held; those of like length together."""
        groups = segments.of_like_length(len(candidates))
        if len(groups) == 1 and segments.lengths.max() == segments.intervals:  # nothing to put apart, or to copy
            return self._simulate(segments, starts, candidates)
        out = np.empty((len(candidates), segments.size, segments.intervals + 1, self.state_size))
        for which in groups:
            last = int(segments.lengths[which].max())
            some = [candidate.pick(which, last) for candidate in candidates]
            states = self._simulate(segments.pick(which).until(last), starts[:, which], some)
            out[:, which, : last + 1], out[:, which, last + 1 :] = states, states[:, :, -1:]
        return out

    def _simulate(self, segments: Segments, starts: Array, candidates: Sequence[Candidate]) -> Array:
        count, size, intervals, model = len(candidates), segments.size, segments.intervals, self.model
        rows = count * size
        halting = any(effect.needs_steps for candidate in candidates for effect in candidate.effects)
        fields = self._fields_for(rows, few=rows <= _FEW and (halting or self.channels.prescribed is not None))
        batch = fields.batch
        fields("opt.timestep")[:rows] = np.tile(np.median(segments.dt, axis=1) / self.substeps, count)
        controls = Controls(segments, candidates, self.substeps, model.nu, self.filters if self._exact else ())
        acting, showing, steady = self._acting(segments, candidates, fields, controls)
        inputs = Inputs(segments, candidates, controls, self.substeps, self.stride, self.late, steady)
        batch.state[:rows] = self._reset_row
        flat = starts.reshape(rows, -1)
        batch.bind("qpos")[:rows], batch.bind("qvel")[:rows] = flat[:, : model.nq], flat[:, model.nq :]
        for own in () if self._exact else self.filters:
            batch.bind("act")[:rows, own.address] = controls.states(own)
        batch.warning[:rows] = 0
        edges = [*range(0, intervals, self.stride), intervals]
        self.work += rows * (len(edges) - 1) * self._steps_in_a_row
        lengths = np.add.reduceat(segments.dt, edges[:-1], axis=1) / self.substeps
        if self.late:  # after the constants: they are those of the machine
            halve_damping(self.model, fields, rows, np.tile(np.median(lengths, axis=1), count))
        steps = np.broadcast_to(lengths, (count, *lengths.shape)).reshape(rows, -1)
        hooks = Hooks([*self._following(segments, lengths, starts[0]), *acting], showing)
        states = np.empty((rows, intervals + 1, self.state_size))
        states[:, 0] = flat
        with warnings_to(_logger.debug), without_timers(), np.errstate(all="ignore"):
            middle = 0.5 * (model.opt.integrator == RUNGE_KUTTA)
            Stepping(batch, inputs, fields, edges, steps, self.substeps, hooks, middle).fill(states)
        if self.stride > 1:
            fill_rows(states, edges, np.tile(segments.dt, (count, 1)), model.nq)
        failed = (batch.warning[:rows, :, 1] > 0).any(axis=1) | (batch.status[:rows] != 0)
        states[failed] = np.nan
        fields.restore(model)
        return states.reshape(count, size, intervals + 1, self.state_size)

    def _acting(
        self, segments: Segments, candidates: Sequence[Candidate], fields: Fields, controls: Controls
    ) -> tuple[list[Act], list[Show], Array]:
        """Edits the models, with the constants that follow.

        Returns:
            What acts in every step, what changes the states that encoders see, and forces that always act.
        """
        size, derived = segments.size, np.zeros(len(candidates), dtype=bool)
        steady = np.zeros((len(candidates) * size, self.model.nv))
        acting: list[Act] = []
        showing: list[Show] = []
        for effect, which, values in grouped(candidates):
            rows = (which[:, None] * size + np.arange(size)).ravel()
            repeated = np.repeat(values, size, axis=0)
            derived[which] |= effect.edit(fields, rows, repeated)
            effect.steady(steady, rows, repeated)
            if effect.needs_steps:
                memory = self._memories(effect, segments, rows, repeated, controls)
                acting.append(before_steps(effect, rows, repeated, memory))
                showing.append(at_rows(effect, rows, repeated, memory))
        fields.derive(np.repeat(derived, size))
        return acting, showing, steady

    def _following(self, segments: Segments, lengths: Array, starts: Array) -> list[Act]:
        """What moves the prescribed joints, where there are any, in substeps of given lengths ``(S, K)``, s."""
        joints = self.channels.prescribed
        if joints is None:
            return []
        steps = np.repeat(lengths, self.substeps, axis=1)
        return [PrescribedMotion(self.model, joints, segments, steps, starts[:, joints.qpos])]

    def _fields_for(self, rows: int, few: bool) -> Fields:
        """A batch with room for so many simulations; a few that stop at every step wait for no other thread."""
        fields = self._fields.get(few)
        if fields is None or fields.batch.nsim < rows:
            capacity = _FEW if few else 1 << max(rows - 1, 0).bit_length()
            try:
                fields = Fields(mujoco.batch.Batch(self.model, capacity, 1 if few else self.nthread))
            except ValueError as error:
                raise ConfigurationError(
                    f"MuJoCo cannot run this model in batches: {error}. Turn that feature off in the model."
                ) from error
            self._fields[few] = fields
            self._reset_row = fields.batch.state[0].copy()
        return fields


def before_steps(effect: Effect, rows: Index, values: Array, memory: Array | None) -> Act:
    """What an effect does before every time step."""
    return lambda step: effect.before_step(step, rows, values, memory)


def at_rows(effect: Effect, rows: Index, values: Array, memory: Array | None) -> Show:
    """How an effect changes what encoders see."""
    return lambda qpos, qvel: effect.show(qpos, qvel, rows, values, memory)


def substeps_for(model: mujoco.MjModel, runs: Sequence[Run]) -> int:
    """Time steps of the model in the median interval between rows."""
    return max(round(median_step(runs) / model.opt.timestep), 1)
