"""How an imagined step moves: along the posterior mean, or wherever optimism likes within the uncertainty."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from torch import Tensor

from torch_activegp import keys
from torch_activegp.errors import ConfigurationError


class Transition(ABC):
    """From posterior quantities to the imagined next state."""

    needs: ClassVar[tuple[str, ...]]
    """The posterior quantities that the next state depends on."""

    @abstractmethod
    def num_extra_actions(self, num_outputs: int) -> int:
        """How many extra actions in [-1, 1] the planner chooses besides the controls."""

    @abstractmethod
    def next_state(self, quantities: dict[str, Tensor], extra: Tensor) -> Tensor:
        """The next state ``(..., d)``, not yet wrapped.

        Args:
            quantities: what :attr:`needs` names, each ``(..., d)``.
            extra: the extra actions, ``(..., e)``.
        """


class MeanTransition(Transition):
    """x' = mu(x, u), as in the paper."""

    needs = (keys.LOC,)

    def num_extra_actions(self, num_outputs: int) -> int:
        """None."""
        return 0

    def next_state(self, quantities: dict[str, Tensor], extra: Tensor) -> Tensor:
        """The posterior mean."""
        return quantities[keys.LOC]


class OptimisticTransition(Transition):
    """x' = mu(x, u) + beta sigma(x, u) eta, with eta in [-1, 1]^d chosen by the planner.

    Args:
        beta: width of the optimism in standard deviations, not negative.

    Raises:
        ConfigurationError: ``beta`` is negative.

    Reference: Sukhija et al. 2023, *Optimistic Active Exploration of Dynamical Systems* (OpAx), Eq. 11; Curi et al.
    2020 (H-UCRL).
    """

    needs = (keys.LOC, keys.SCALE)

    def __init__(self, beta: float = 1.0) -> None:
        if not beta >= 0:
            raise ConfigurationError(f"Wanted beta >= 0, found {beta}.")
        self.beta = beta

    def num_extra_actions(self, num_outputs: int) -> int:
        """One for each state."""
        return num_outputs

    def next_state(self, quantities: dict[str, Tensor], extra: Tensor) -> Tensor:
        """The posterior mean moved by the chosen number of standard deviations."""
        return quantities[keys.LOC] + self.beta * quantities[keys.SCALE] * extra
