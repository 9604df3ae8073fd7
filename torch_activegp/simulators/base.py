"""The one protocol of all simulators: a batched step from (state, action) to the next state."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.simulators.space import ActionSpace, StateSpace


def broadcast_batch(first: torch.Size, second: torch.Size) -> torch.Size:
    """`torch.broadcast_shapes` of two, without its 30 microseconds where they are equal."""
    return first if first == second else torch.broadcast_shapes(first, second)


class Simulator(nn.Module, ABC):
    """A one-step map of a machine, batched over leading dimensions.

    A subclass implements ``step``. Call the simulator itself where the shapes are not yet trusted, and ``step`` in
    inner loops.

    Args:
        state_space: names, bounds, angles and quaternions of the state.
        action_space: names and bounds of the action.
        dt: time between two states, s.

    Raises:
        ConfigurationError: ``dt`` is not positive and finite.
    """

    def __init__(self, state_space: StateSpace, action_space: ActionSpace, dt: float) -> None:
        super().__init__()
        if not 0.0 < dt < float("inf"):
            raise ConfigurationError(f"Simulator: wanted a time step `dt` > 0 s, found {dt}.")
        self.state_space = state_space
        self.action_space = action_space
        self.dt = float(dt)

    @property
    def state_dim(self) -> int:
        """Number of state dimensions d."""
        return self.state_space.dim

    @property
    def action_dim(self) -> int:
        """Number of action dimensions m."""
        return self.action_space.dim

    @abstractmethod
    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advances states by ``dt``, without any check of the shapes.

        Args:
            state: ``(..., d)``.
            action: ``(..., m)``; its batch dimensions broadcast with those of ``state``.

        Returns:
            Next state, ``(..., d)``, angles in [-pi, pi), quaternions of unit length. A sample that diverges is not
            finite, and leaves the others as they are.
        """

    def forward(self, state: Tensor, action: Tensor) -> Tensor:
        """Checks the shapes, then steps.

        Args:
            state: ``(..., d)``.
            action: ``(..., m)``.

        Returns:
            Next state, ``(..., d)``.

        Raises:
            ShapeError: a last dimension is not d or m, or the batch dimensions do not broadcast.
        """
        self._check_shapes(state, action, action.shape[:-1])
        return self.step(state, action)

    def rollout(self, state: Tensor, actions: Tensor) -> Tensor:
        """Applies a sequence of actions.

        Args:
            state: initial states, ``(..., d)``.
            actions: ``(..., T, m)``, each held for ``dt``.

        Returns:
            The states after each action, ``(..., T, d)``.

        Raises:
            ShapeError: ``actions`` lacks the time dimension, a last dimension is not d or m, or the batch dimensions
                do not broadcast.
        """
        batch = self._check_rollout(state, actions)
        states = []
        current = state.expand(*batch, self.state_dim)
        for action in actions.unbind(-2):
            current = self.step(current, action)
            states.append(current)
        return torch.stack(states, dim=-2) if states else state.new_empty(*batch, 0, self.state_dim)

    def _check_rollout(self, state: Tensor, actions: Tensor) -> torch.Size:
        if actions.dim() < 2:
            raise ShapeError(
                f"rollout: wanted actions (..., T, {self.action_dim}), found shape {tuple(actions.shape)}. "
                "Add the time dimension, e.g. `actions.unsqueeze(-2)`."
            )
        return self._check_shapes(state, actions, actions.shape[:-2])

    def _check_shapes(self, state: Tensor, action: Tensor, action_batch: torch.Size) -> torch.Size:
        for label, tensor, space in (("state", state, self.state_space), ("action", action, self.action_space)):
            if tensor.dim() == 0 or tensor.shape[-1] != space.dim:
                raise ShapeError(
                    f"{type(self).__name__}: wanted {label} (..., {space.dim}) with {list(space.names)}, "
                    f"found shape {tuple(tensor.shape)}."
                )
        try:
            return broadcast_batch(state.shape[:-1], action_batch)
        except RuntimeError as error:
            raise ShapeError(
                f"{type(self).__name__}: the batch dimensions of state {tuple(state.shape[:-1])} and action "
                f"{tuple(action_batch)} do not broadcast. Make them equal, or 1 where one is repeated."
            ) from error
