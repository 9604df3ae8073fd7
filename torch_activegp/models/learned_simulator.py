"""What was learned, as a simulator again."""

from __future__ import annotations

import torch
from torch import Tensor

from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.models.dynamics_gp import DynamicsGP
from torch_activegp.simulators import ActionSpace, Simulator


class LearnedSimulator(Simulator):
    """The GP's posterior mean as a :class:`~torch_activegp.simulators.Simulator`.

    It can replace the imperfect simulator everywhere, also as the mean of another GP.

    Args:
        gp: the model.
        action_space: names and bounds of the action.
        dt: time between two states, s.
        trust: how much of the learned correction is believed, ``(d,)`` in [0, 1]; see
            :class:`~torch_activegp.models.HeldOutGuard`. Default 1.

    Raises:
        ConfigurationError: the GP has no state space.
        ShapeError: ``trust`` is not ``(d,)``.
    """

    trust: Tensor

    def __init__(self, gp: DynamicsGP, action_space: ActionSpace, dt: float, trust: Tensor | None = None) -> None:
        if gp.state_space is None:
            raise ConfigurationError("Wanted a GP with a state space. Pass DynamicsGP(..., state_space=...).")
        if trust is not None and trust.shape != gp.output_scale.shape:
            raise ShapeError(f"Wanted trust of shape {tuple(gp.output_scale.shape)}, found {tuple(trust.shape)}.")
        super().__init__(gp.state_space, action_space, dt)
        self.gp = gp
        self.register_buffer("trust", torch.ones_like(gp.output_scale) if trust is None else trust.to(gp.output_scale))

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advance states ``(..., d)`` under actions ``(..., m)``; see :meth:`Simulator.step`."""
        batch = torch.broadcast_shapes(state.shape[:-1], action.shape[:-1])
        z = torch.cat([state.expand(*batch, -1), action.expand(*batch, -1)], dim=-1).to(self.trust)
        posterior = self.gp.posterior
        features = posterior.features(z.reshape(-1, z.shape[-1]))
        base = features.simulator_loc
        loc = base + self.trust * (posterior.loc(features) - base)
        return self.state_space.wrap(loc).reshape(*batch, -1).to(state.dtype)
