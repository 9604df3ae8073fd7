"""Tasks: a true system, an imperfect simulator of it, and how the GP is set up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import gpytorch
import torch
from torch import Tensor

from torch_activegp.errors import ConfigurationError
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, InverseSquareNoise, NoiseSchedule
from torch_activegp.simulators import LocalBrake, Pendulum, Simulator


@dataclass(frozen=True)
class GPSettings:
    """Kernel, noise and recursion of the GP in a task; all methods share them.

    Attributes:
        lengthscale: of the RBF kernel, one for each input, or one for all.
        noise: schedule of the relative noise variance.
        recursion: ``"paper"`` or ``"bayes"``; see :class:`~torch_activegp.means.EpisodicMean`.
        output_scale: signal standard deviation of each state, in its unit; None for ones.
    """

    lengthscale: tuple[float, ...]
    noise: NoiseSchedule
    recursion: str
    output_scale: tuple[float, ...] | None = None

    def make(self, simulator: Simulator, *, with_prior: bool) -> DynamicsGP:
        """A fresh GP.

        Args:
            simulator: the imperfect simulator.
            with_prior: whether it is the mean; otherwise the mean of the next state is zero.
        """
        zero = gpytorch.means.ZeroMean(batch_shape=torch.Size([simulator.state_dim]))
        mean = SimulatorMean(simulator) if with_prior else zero
        kernel = gpytorch.kernels.RBFKernel(ard_num_dims=len(self.lengthscale) if len(self.lengthscale) > 1 else None)
        scale = None if self.output_scale is None else torch.tensor(self.output_scale, dtype=torch.float64)
        gp = DynamicsGP(
            EpisodicMean(mean, self.recursion),
            kernel,
            noise=self.noise,
            state_space=simulator.state_space,
            output_scale=scale,
        )
        kernel.lengthscale = torch.tensor(self.lengthscale, dtype=torch.float64)
        return gp


@dataclass(frozen=True)
class Task:
    """A system to learn.

    Attributes:
        name: for file names and titles.
        truth: the true dynamics; plays the real system.
        prior: the imperfect simulator.
        gp: how the GP is set up.
        grid: points per input of the test grid.
    """

    name: str
    truth: Simulator
    prior: Simulator
    gp: GPSettings
    grid: int = 20

    def __post_init__(self) -> None:
        """Check that truth and prior speak of the same system.

        Raises:
            ConfigurationError: they have other states or actions.
        """
        for kind in ("state_space", "action_space"):
            ours, theirs = getattr(self.truth, kind).names, getattr(self.prior, kind).names
            if ours != theirs:
                raise ConfigurationError(
                    f"Task {self.name}: wanted the same {kind.replace('_space', 's')} in truth and prior, found "
                    f"{list(ours)} and {list(theirs)}."
                )

    def test_points(self) -> tuple[Tensor, Tensor]:
        """The test grid z = (x, u) ``(n, d + m)`` and the true next states ``(n, d)``."""
        states, actions = self.truth.state_space.grid(self.grid), self.truth.action_space.grid(self.grid)
        z = torch.cat([states.repeat_interleave(len(actions), 0), actions.repeat(len(states), 1)], dim=-1)
        return z, self.truth.step(z[:, : states.shape[-1]], z[:, states.shape[-1] :])


PRINTED = GPSettings(lengthscale=(1.0,), noise=InverseSquareNoise(), recursion="paper")
"""The paper's printed settings: k = exp(-0.5 |z - z'|^2), sigma^2 = 1 / n^2."""


def pendulum() -> Task:
    """The paper's pendulum: truth g 9.81, m 1, l 1; prior g 9.0, m 0.5, l 2.0; equation as printed.

    Reference: Miller et al. 2024 (arXiv 2403.17233), section IV.
    """
    return Task("pendulum", Pendulum(), Pendulum(g=9.0, m=0.5, l=2.0), PRINTED)


def pendulum_brake() -> Task:
    """A pendulum whose prior is right but for a brake near theta = 1.2 rad, about a tenth of the volume."""
    truth = Pendulum(extra_torque=LocalBrake(center=1.2, width=0.25, damping=0.5))
    settings = GPSettings(
        lengthscale=(0.35, 1.2, 4.0), noise=FixedNoise(1e-3), recursion="bayes", output_scale=(0.02, 0.4)
    )
    return Task("pendulum-brake", truth, Pendulum(), settings)


TASKS: dict[str, Callable[[], Task]] = {"pendulum": pendulum, "pendulum-brake": pendulum_brake}
"""The tasks that the command line knows by name."""
