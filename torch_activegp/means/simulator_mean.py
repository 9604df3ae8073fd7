"""An imperfect simulator as the mean function of a Gaussian process."""

from __future__ import annotations

import gpytorch
import torch
from torch import Tensor

from torch_activegp.errors import ShapeError
from torch_activegp.means.layout import evaluate_per_output
from torch_activegp.simulators import Simulator, StateSpace


class SimulatorMean(gpytorch.means.Mean):
    """The prior mean p0(z) with z = (x, u): what the simulator says comes next.

    It is a gpytorch mean of batch shape ``(d,)``. If the simulator's parameters require gradients, they are trained
    with the other hyper-parameters.

    Args:
        simulator: any :class:`~torch_activegp.simulators.Simulator` with ``d`` states and ``m`` actions.

    Example:
        >>> from torch_activegp.simulators import Pendulum
        >>> mean = SimulatorMean(Pendulum())
        >>> mean(torch.zeros(5, 3, dtype=torch.float64)).shape  # gpytorch's layout: (d, n)
        torch.Size([2, 5])

    Reference: Miller et al. 2024 (arXiv 2403.17233), section III, p_0.
    """

    def __init__(self, simulator: Simulator) -> None:
        super().__init__()
        self.simulator = simulator
        self.batch_shape = torch.Size([simulator.state_space.dim])

    @property
    def state_space(self) -> StateSpace:
        """The simulator's state space: names, bounds, angles."""
        return self.simulator.state_space

    def predict(self, z: Tensor) -> Tensor:
        """The simulator's next state.

        Args:
            z: states and actions side by side, ``(..., d + m)``.

        Returns:
            The next state, ``(..., d)``.
        """
        return self.simulator.step(z[..., : self.batch_shape[0]], z[..., self.batch_shape[0] :])

    def forward(self, x: Tensor) -> Tensor:
        """The mean in gpytorch's layout.

        Args:
            x: inputs, ``(n, d + m)`` or ``(..., d, n, d + m)``.

        Returns:
            The mean, ``(..., d, n)``.

        Raises:
            ShapeError: the last dimension is not ``d + m``.
        """
        wanted = self.simulator.state_space.dim + self.simulator.action_space.dim
        if x.shape[-1] != wanted:
            raise ShapeError(
                f"Wanted {wanted} columns ({self.simulator.state_space.dim} states, "
                f"{self.simulator.action_space.dim} actions), found {x.shape[-1]}. Concatenate state and action."
            )
        return evaluate_per_output(self.predict, x, self.batch_shape[0])
