"""What all rules for the start of an episode are: modules without arguments that return a state."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import ActionSpace, StateSpace


class EpisodeStart(nn.Module, ABC):
    """A rule that looks for a start state in the box of states and actions.

    The generator is part of the ``state_dict``, so that a resumed run draws the same starts; the model is not.

    Args:
        gp: the model; its state space must be bounded.
        action_space: bounds of the actions.
        seed: of all draws.

    Raises:
        ConfigurationError: the GP has no state space, or a bound is infinite.
    """

    gp: DynamicsGP
    state_space: StateSpace
    low: Tensor
    high: Tensor

    def __init__(self, gp: DynamicsGP, action_space: ActionSpace, seed: int) -> None:
        super().__init__()
        space = state_space_of(gp)
        low, high = bounded_box(space, action_space)
        self.register_buffer("low", low, persistent=False)
        self.register_buffer("high", high, persistent=False)
        self.__dict__.update(gp=gp, state_space=space)  # not submodules: the start does not own the model
        self.generator = torch.Generator().manual_seed(seed)

    @abstractmethod
    def forward(self) -> Tensor:
        """Choose a start state, ``(d,)``."""

    def get_extra_state(self) -> Tensor:
        """The generator's state."""
        return self.generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Restore the generator."""
        self.generator.set_state(state.cpu())


def state_space_of(gp: DynamicsGP) -> StateSpace:
    """The names, bounds and angles of a GP's states.

    Raises:
        ConfigurationError: it has none.
    """
    space = gp.state_space
    if not isinstance(space, StateSpace):
        raise ConfigurationError("The GP has no state space. Pass DynamicsGP(..., state_space=StateSpace(...)).")
    return space


def bounded_box(space: StateSpace, action_space: ActionSpace) -> tuple[Tensor, Tensor]:
    """The corners of the box of states and actions, each ``(d + m,)``.

    Raises:
        ConfigurationError: a bound is infinite.
    """
    low, high = torch.cat([space.low, action_space.low]), torch.cat([space.high, action_space.high])
    if not bool(torch.isfinite(high - low).all()):
        raise ConfigurationError(
            f"Wanted finite bounds of states and actions, found low={low.tolist()}, "
            f"high={high.tolist()}. Give the simulator bounds that cover what may be visited, or start at the "
            "environment's own reset (start=None)."
        )
    return low, high
