"""A simulator from the user's own torch function or module."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from torch_activegp.errors import SimulationError
from torch_activegp.simulators.base import Simulator, broadcast_batch
from torch_activegp.simulators.space import ActionSpace, StateSpace


class FunctionSimulator(Simulator):
    """Wraps ``(state, action) -> next state``.

    Args:
        fn: function or ``nn.Module`` from states ``(..., d)`` and actions ``(..., m)`` to next states ``(..., d)``. The
            parameters of a module belong to the simulator.
        state_space: names, bounds, angles and quaternions of the state; or d alone, for unbounded states on a line.
        action_space: names and bounds of the action; or m alone, for unbounded actions.
        dt: time between two states, s.

    Raises:
        ConfigurationError: ``dt`` is not positive.

    Example:
        >>> import torch
        >>> drift = FunctionSimulator(lambda state, action: state + 0.1 * action, 2, 2, dt=0.1)
        >>> drift(torch.zeros(5, 2), torch.ones(5, 2)).shape
        torch.Size([5, 2])
    """

    def __init__(
        self,
        fn: Callable[[Tensor, Tensor], Tensor],
        state_space: StateSpace | int,
        action_space: ActionSpace | int,
        dt: float,
    ) -> None:
        infinity = float("inf")
        if isinstance(state_space, int):
            state_space = StateSpace([f"state{index}" for index in range(state_space)], -infinity, infinity)
        if isinstance(action_space, int):
            action_space = ActionSpace([f"action{index}" for index in range(action_space)], -infinity, infinity)
        super().__init__(state_space, action_space, dt)
        self.fn = fn

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advances states ``(..., d)`` by ``dt`` under actions ``(..., m)``; see `Simulator.step`.

        Raises:
            SimulationError: ``fn`` returns something that is not a tensor of next states.
        """
        next_state = self.fn(state, action)
        self._check_result(next_state, state, action)
        return self.state_space.wrap(next_state)

    def _check_result(self, result: Tensor, state: Tensor, action: Tensor) -> None:
        if isinstance(result, Tensor):
            wanted = (*broadcast_batch(state.shape[:-1], action.shape[:-1]), self.state_dim)
            if result.shape == wanted:
                return
            found = f"shape {tuple(result.shape)}"
        else:
            wanted, found = (..., self.state_dim), f"a {type(result).__name__}"
        name = getattr(self.fn, "__name__", type(self.fn).__name__)
        raise SimulationError(
            f"FunctionSimulator: wanted the next states {wanted} from `{name}` for states {tuple(state.shape)} and "
            f"actions {tuple(action.shape)}, found {found}. Return one tensor with the batch dimensions of the two."
        )
