"""A simulator from an ordinary differential equation written in torch."""

from __future__ import annotations

from torch import Tensor

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.base import Simulator
from torch_activegp.simulators.integrators import Dynamics, Integrator, rk4
from torch_activegp.simulators.space import ActionSpace, StateSpace


class OdeSimulator(Simulator):
    """Integrates ``d state / dt = dynamics(state, action)`` with the action held and clipped to its bounds.

    Args:
        dynamics: function or ``nn.Module`` ``(state (..., d), action (..., m)) -> (..., d)``, in units per second. The
            parameters of a module belong to the simulator, and gradients flow to them.
        state_space: names, bounds, angles and quaternions of the state.
        action_space: names and bounds of the action.
        dt: time between two states, s.
        integrator: ``rk4``, ``semi_implicit_euler``, or any function of the same signature.
        substeps: number of integrator steps within ``dt``.

    Raises:
        ConfigurationError: ``dt`` or ``substeps`` is not positive.

    Example:
        >>> import torch
        >>> spring = OdeSimulator(
        ...     lambda x, u: torch.cat((x[..., 1:], u - x[..., :1]), -1),
        ...     StateSpace(["q", "v"], -1.0, 1.0),
        ...     ActionSpace(["force"], -1.0, 1.0),
        ...     dt=0.1,
        ... )
        >>> round(spring(torch.tensor([1.0, 0.0]), torch.zeros(1))[0].item(), 4)  # cos(0.1)
        0.995
    """

    def __init__(
        self,
        dynamics: Dynamics,
        state_space: StateSpace,
        action_space: ActionSpace,
        dt: float,
        integrator: Integrator = rk4,
        substeps: int = 1,
    ) -> None:
        super().__init__(state_space, action_space, dt)
        if substeps < 1:
            raise ConfigurationError(f"OdeSimulator: wanted `substeps` >= 1, found {substeps}.")
        self.dynamics = dynamics
        self.integrator = integrator
        self.substeps = int(substeps)

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advances states ``(..., d)`` by ``dt`` under actions ``(..., m)``; see `Simulator.step`."""
        action = self.action_space.clamp(action)
        interval = self.dt / self.substeps
        for _ in range(self.substeps):
            state = self.integrator(self.dynamics, state, action, interval)
        return self.state_space.wrap(state)
