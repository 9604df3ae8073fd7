"""A simulator with named effects in it, as the diagnosis simulated them."""

from __future__ import annotations

import dataclasses
import logging
import math
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.inputs.source import Source
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.correction import Form
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.explicit_damping import explicit
from torch_activegp.errors import ConfigurationError, SimulationError
from torch_activegp.physics.friction import sticking
from torch_activegp.simulators import MujocoSimulator, Simulator
from torch_activegp.simulators.mujoco_layout import action_space, state_space

_logger = logging.getLogger(__name__)


class EffectSimulator(Simulator):
    """A MuJoCo model with effects that MJCF cannot hold; state (qpos, qvel), action ctrl.

    It is stepped like a candidate of the diagnosis. What the state cannot hold (a delayed control, the far side of a
    backlash) lives through one ``rollout``, which begins as a recording does, and starts anew at each ``step``, with a
    rotor where it pushes. Effects on sensors change recordings, not the motion, and do nothing here.

    Args:
        model: nominal model, without activations.
        channels: the joints that effects with a memory follow; all move by themselves, also those that were prescribed.
        candidate: effects and their values.
        dt: time between two states, s.
        substeps: time steps in ``dt``.
        integrator: one of ``mujoco.mjtIntegrator``; None for the model's own.

    Raises:
        ConfigurationError: the model has actuators with activations.
    """

    _gives_none = "MuJoCo gives none"

    def __init__(
        self,
        model: mujoco.MjModel,
        channels: Channels,
        candidate: Candidate,
        *,
        dt: float,
        substeps: int,
        integrator: int | None = None,
    ) -> None:
        if model.na:
            raise ConfigurationError(
                "EffectSimulator: wanted a model whose state is (qpos, qvel), found actuators with activations."
            )
        super().__init__(state_space(model), action_space(model), dt)
        self.model, self.channels, self.candidate = model, dataclasses.replace(channels, prescribed=None), candidate
        self.substeps, self.integrator = substeps, integrator
        self._order = np.arange(self.state_dim)
        """Which dimensions of the state the engine's are."""
        self._engine: Engine | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_engine": None}

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advances states ``(..., d)`` by ``dt``; see `Simulator.step`.

        Raises:
            SimulationError: an input requires a gradient.
        """
        return self._follow(state, action.unsqueeze(-2), self.candidate.anew()).squeeze(-2)

    def rollout(self, state: Tensor, actions: Tensor) -> Tensor:
        """Applies a sequence of actions; see `Simulator.rollout`.

        Raises:
            ShapeError: the shapes do not fit.
            SimulationError: an input requires a gradient.
        """
        return self._follow(state, actions, self.candidate)

    def _follow(self, state: Tensor, actions: Tensor, candidate: Candidate) -> Tensor:
        batch = self._check_rollout(state, actions)
        if torch.is_grad_enabled() and (state.requires_grad or actions.requires_grad):
            raise SimulationError(
                f"{type(self).__name__}: an input requires a gradient, and {self._gives_none}. Detach it."
            )
        size, count = batch.numel(), actions.shape[-2]
        if size == 0 or count == 0:
            return state.new_empty(*batch, count, self.state_dim)
        begin = as_numbers(state.expand(*batch, self.state_dim)).reshape(size, self.state_dim)[:, self._order]
        limited = self.action_space.clamp(actions.expand(*batch, *actions.shape[-2:]))
        control = as_numbers(limited).reshape(size, count, self.action_dim)
        if self._engine is None:
            self._engine = Engine(self.model, self.channels, self.substeps, integrator=self.integrator)
        after = self._engine.trajectories(self._segments(begin, control), begin, candidate)[:, 1:]
        states = torch.empty(size, count, self.state_dim, dtype=torch.float64)
        states[..., self._order] = torch.from_numpy(after)
        states = states.reshape(*batch, count, self.state_dim).to(self.state_space.low.device)
        return self.state_space.wrap(states).to(state)

    def engine_for(self, channels: Channels, interval: float, nthread: int = 0) -> Engine:
        """What simulates it over recordings with so long between rows, s, in time steps no longer than its own."""
        steps = max(math.ceil(interval * self.substeps / self.dt - 1e-6), 1)
        return Engine(self.model, channels, steps, nthread, self.integrator)

    def _segments(self, begin: Array, control: Array) -> Segments:
        """Every sample as a run of its own, so that nothing passes from one to the next."""
        model, channels = self.model, self.channels
        size, count = control.shape[:2]
        time, rows = self.dt * np.arange(count + 1), np.ones((count + 1, 1))
        free, zeros = np.zeros((count, model.nv)), np.zeros(len(channels.joints))
        runs = []
        for row, held in zip(begin, control, strict=True):
            position, velocity = rows * row[channels.qpos], rows * row[model.nq + channels.dof]
            recorded = np.ones(count + 1, dtype=bool)
            runs.append(Run("", time, position, recorded, velocity, position, held, free, zeros))
        return Segments(
            tuple(runs),
            np.arange(size),
            np.zeros(size, dtype=np.int64),
            np.zeros((size, count + 1, len(zeros))),
            np.ones((size, count + 1), dtype=bool),
            np.full((size, count), self.dt),
            np.tile(np.array([0, count]), (size, 1)),
        )


def corrected_simulator(
    source: Source,
    channels: Channels,
    candidate: Candidate,
    xml: str | None,
    numerics: Form | None = None,
) -> Simulator | None:
    """The simulator with effects in it.

    Args:
        source: the nominal model.
        channels: the recorded joints.
        candidate: the effects.
        xml: MJCF text that holds all of them, or None.
        numerics: how the fit integrated, where that is not the model's own way.

    Returns:
        A `MujocoSimulator` where there is such a text, else an `EffectSimulator`; both with the nominal's time between
        two states. None for a model with activations whose effects MJCF cannot hold.
    """
    model = source.model
    dt = float(model.opt.timestep) * source.frame_skip
    form = numerics or Form(int(model.opt.integrator), float(model.opt.timestep))
    step, integrator = form.step, form.integrator
    substeps = max(math.ceil(dt / step - 1e-6), 1)
    if xml is not None:
        try:
            made = MujocoSimulator(xml).model
            made.opt.timestep, made.opt.integrator = dt / substeps, integrator
            return MujocoSimulator(made, frame_skip=substeps)
        except ConfigurationError:  # text alone does not find the model's own meshes
            _logger.debug("the corrected text does not compile alone")
    if model.na:
        return None
    model = sticking(model, dt / substeps) if form.firm else model
    model = explicit(model) if form.explicit else model
    return EffectSimulator(model, channels, candidate, dt=dt, substeps=substeps, integrator=integrator)


def as_numbers(tensor: Tensor) -> Array:
    """A tensor of any device and kind as an array of doubles, of the same shape."""
    return np.asarray(tensor.detach().to(device="cpu", dtype=torch.float64).numpy())
