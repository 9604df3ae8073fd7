"""A user's simulator, watched: whatever goes wrong in it is reported with its name."""

from __future__ import annotations

import torch
from torch import Tensor

from torch_activegp.errors import ActiveGPError, SimulationError
from torch_activegp.simulators import ActionSpace, Simulator, StateSpace
from torch_activegp.simulators.base import broadcast_batch
from torch_activegp.simulators.load import USER_FAULTS


class UserSimulator(Simulator):
    """Another simulator, whose errors say which simulator it was.

    Args:
        simulator: what to watch.
        source: its name, as the user wrote it.
        finite: also refuse next states that are not finite. Right for the true system; an imperfect simulator may
            diverge in a plan, and the planner drops that plan.

    Example:
        >>> from torch_activegp.simulators import FunctionSimulator
        >>> broken = UserSimulator(FunctionSimulator(lambda state, action: state / 0, 1, 1, dt=1.0), "mine:make")
        >>> broken(torch.ones(1), torch.ones(1))
        Traceback (most recent call last):
        torch_activegp.errors.SimulationError: `mine:make` returned [inf] from state {'state0': 1.0} ...
    """

    def __init__(self, simulator: Simulator, source: str, *, finite: bool = True) -> None:
        super().__init__(simulator.state_space, simulator.action_space, simulator.dt)
        self.simulator = simulator
        self.source = source
        self.finite = finite

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advances states ``(..., d)`` under actions ``(..., m)``; see `Simulator.step`.

        Raises:
            SimulationError: the simulator raised an error, or returned something else than finite states ``(..., d)``.
        """
        try:
            following = self.simulator.step(state, action)
        except USER_FAULTS as error:
            what = str(error) if isinstance(error, ActiveGPError) else f"{type(error).__name__}: {error}"
            raise SimulationError(
                f"`{self.source}` failed for states {tuple(state.shape)} and actions {tuple(action.shape)}: {what}"
            ) from error
        wanted = (*broadcast_batch(state.shape[:-1], action.shape[:-1]), self.state_dim)
        if not isinstance(following, Tensor) or following.shape != wanted:
            found = f"shape {tuple(following.shape)}" if isinstance(following, Tensor) else type(following).__name__
            raise SimulationError(
                f"`{self.source}` returned {found} for states {tuple(state.shape)} and actions "
                f"{tuple(action.shape)}, wanted {wanted}. Return the next states with the batch dimensions of both."
            )
        if self.finite:
            require_finite(self, following, state, action)
        return following


def name_of(simulator: Simulator) -> str:
    """How to speak of a simulator: as the user wrote it, or by its class."""
    return simulator.source if isinstance(simulator, UserSimulator) else type(simulator).__name__


def require_finite(simulator: Simulator, following: Tensor, state: Tensor, action: Tensor) -> None:
    """Checks next states ``(..., d)`` that a simulator returned for states ``(..., d)`` and actions ``(..., m)``.

    Raises:
        SimulationError: one is not finite; names the simulator, the state and the action.
    """
    bad = ~torch.isfinite(following).all(-1).reshape(-1)
    if not bool(bad.any()):
        return
    row = int(bad.nonzero()[0])
    batch = following.shape[:-1]
    named = {
        kind: _named(space, values.expand(*batch, -1).reshape(-1, space.dim)[row])
        for kind, space, values in (
            ("state", simulator.state_space, state),
            ("action", simulator.action_space, action),
        )
    }
    raise SimulationError(
        f"`{name_of(simulator)}` returned {following.reshape(-1, following.shape[-1])[row].tolist()} from state "
        f"{named['state']} under action {named['action']}. Mend it there, or narrow its bounds to where it holds "
        "(on the command line: --bounds NAME=LOW:HIGH)."
    )


def _named(space: StateSpace | ActionSpace, values: Tensor) -> dict[str, float]:
    return {name: round(value, 6) for name, value in zip(space.names, values.tolist(), strict=True)}
