"""Tasks: a true system, an imperfect simulator of it, and how the GP is set up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import gpytorch
import torch
from torch import Tensor, nn
from torch.quasirandom import SobolEngine

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.user_simulator import name_of, require_finite
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import (
    DynamicsGP,
    FixedNoise,
    InverseSquareNoise,
    LearnedNoise,
    NoiseSchedule,
    fit_output_scale,
    scaled_rbf,
)
from torch_activegp.simulators import JointStop, LocalBrake, Magnet, Pendulum, Simulator

_FIRST_NOISE = 1e-4
"""Noise variance in the first episode of a GP whose noise is fitted."""
_LEAST_NOISE = 1e-40
"""Least noise variance of such a GP, in squared units of the states."""


@dataclass(frozen=True)
class GPSettings:
    """Kernel, noise and recursion of the GP in a task; all methods share them.

    Attributes:
        lengthscale: of the RBF kernel, one for each input, or one for all; None to fit them, the signal variances and
            the noise after each episode.
        noise: schedule of the relative noise variance.
        recursion: ``"paper"`` or ``"bayes"``; see :class:`~torch_activegp.means.EpisodicMean`.
        output_scale: signal standard deviation of each state, in its unit; None for ones.
        fit: called with the GP between episodes; None to keep its hyper-parameters.
    """

    lengthscale: tuple[float, ...] | None
    noise: NoiseSchedule
    recursion: str
    output_scale: tuple[float, ...] | None = None
    fit: Callable[[DynamicsGP], None] | None = None

    @property
    def fitted(self) -> bool:
        """Whether the hyper-parameters are fitted."""
        return self.lengthscale is None

    def make(self, simulator: Simulator, *, with_prior: bool) -> DynamicsGP:
        """A fresh GP.

        Args:
            simulator: the imperfect simulator.
            with_prior: whether it is the mean; otherwise the mean of the next state is zero.
        """
        zero = gpytorch.means.ZeroMean(batch_shape=torch.Size([simulator.state_dim]))
        mean = SimulatorMean(simulator) if with_prior else zero
        scale = None if self.output_scale is None else torch.tensor(self.output_scale, dtype=torch.float64)
        gp = DynamicsGP(
            EpisodicMean(mean, self.recursion),
            self._kernel(simulator),
            noise=self.noise,
            state_space=simulator.state_space,
            output_scale=scale,
            likelihood=self._likelihood(simulator.state_dim) if self.fitted else None,
        )
        if self.fitted:
            gp.likelihood.noise = _FIRST_NOISE
        return gp

    def _likelihood(self, num_outputs: int) -> gpytorch.likelihoods.GaussianLikelihood:
        """One noise for each output, as small as that of a state which the imperfect simulator predicts exactly."""
        constraint = gpytorch.constraints.GreaterThan(_LEAST_NOISE)
        return gpytorch.likelihoods.GaussianLikelihood(
            batch_shape=torch.Size([num_outputs]), noise_constraint=constraint
        )

    def _kernel(self, simulator: Simulator) -> gpytorch.kernels.Kernel:
        if self.lengthscale is None:
            states, actions = simulator.state_space, simulator.action_space
            return scaled_rbf(torch.cat([states.low, actions.low]), torch.cat([states.high, actions.high]))
        kernel = gpytorch.kernels.RBFKernel(ard_num_dims=len(self.lengthscale) if len(self.lengthscale) > 1 else None)
        kernel.to(torch.float64).lengthscale = torch.tensor(self.lengthscale, dtype=torch.float64)
        return kernel


@dataclass(frozen=True)
class Task:
    """A system to learn.

    Attributes:
        name: for file names and titles.
        truth: the true dynamics; plays the real system.
        prior: the imperfect simulator.
        gp: how the GP is set up.
        description: one sentence, for a person who starts a run.
        unit: of the states, for the axes of figures.
        grid: points per input of the test grid; in more than three dimensions that many cubed, as a Sobol set.

    Raises:
        ConfigurationError: truth and prior have other states, actions or time steps, or a bound is infinite.
    """

    name: str
    truth: Simulator
    prior: Simulator
    gp: GPSettings
    description: str = ""
    unit: str = "units of the states"
    grid: int = 20

    def __post_init__(self) -> None:
        """Check that truth and prior speak of the same system, in a box that can be explored."""
        for kind, space in (("states", "state_space"), ("actions", "action_space")):
            ours, theirs = getattr(self.truth, space).names, getattr(self.prior, space).names
            if ours != theirs:
                raise ConfigurationError(
                    f"{self.name}: wanted the same {kind} in the true system and the imperfect simulator, found "
                    f"{list(ours)} in `{name_of(self.truth)}` and {list(theirs)} in `{name_of(self.prior)}`. Rename "
                    "or reorder one of them."
                )
        if self.truth.dt != self.prior.dt:
            raise ConfigurationError(
                f"{self.name}: wanted one time step, found {self.truth.dt} s in `{name_of(self.truth)}` and "
                f"{self.prior.dt} s in `{name_of(self.prior)}`."
            )
        self._require_bounds()

    def _require_bounds(self) -> None:
        names = dict.fromkeys(
            name
            for simulator in (self.truth, self.prior)
            for space in (simulator.state_space, simulator.action_space)
            for name, width in zip(space.names, (space.high - space.low).tolist(), strict=True)
            if width == float("inf")
        )
        if names:
            raise ConfigurationError(
                f"{self.name}: wanted finite bounds, in which to look for informative states, found none for "
                f"{', '.join(names)}. Give the simulator bounds that cover what may be visited; on the command line "
                f"add {' '.join(f'--bounds {name}=LOW:HIGH' for name in names)} with numbers."
            )

    def test_points(self) -> tuple[Tensor, Tensor]:
        """The test points z = (x, u) ``(n, d + m)`` and the true next states ``(n, d)``.

        Raises:
            SimulationError: the true system is not finite at one of them.
        """
        states, actions = self.truth.state_space, self.truth.action_space
        if states.dim + actions.dim <= 3 and not states.quaternions:
            x, u = states.grid(self.grid), actions.grid(self.grid)
            x, u = x.repeat_interleave(len(u), 0), u.repeat(len(x), 1)
        else:
            x, u = self._sobol_points(self.grid**3)
        with torch.no_grad():
            following = self.truth.step(x, u)
        require_finite(self.truth, following, x, u)
        return torch.cat([x, u], dim=-1), following

    def _sobol_points(self, count: int) -> tuple[Tensor, Tensor]:
        states, actions = self.truth.state_space, self.truth.action_space
        low, high = torch.cat([states.low, actions.low]), torch.cat([states.high, actions.high])
        points = torch.lerp(low, high, SobolEngine(len(low)).draw(count, dtype=low.dtype))
        return states.wrap(points[:, : states.dim]), points[:, states.dim :]


PRINTED = GPSettings(lengthscale=(1.0,), noise=InverseSquareNoise(), recursion="paper")
"""The paper's printed settings: k = exp(-0.5 |z - z'|^2), sigma^2 = 1 / n^2."""

LOCAL = GPSettings(
    lengthscale=(0.35, 1.2, 4.0),
    noise=FixedNoise(1e-3),
    recursion="bayes",
    output_scale=(0.02, 0.4),
    fit=fit_output_scale,
)
"""For an effect that lives in a part of the pendulum's space: length-scales of its size, fitted signal scale."""

FITTED = GPSettings(lengthscale=None, noise=LearnedNoise(), recursion="bayes")
"""For a system that nobody has tuned the kernel for: hyper-parameters are fitted after each episode."""


_EQUATIONS = {
    "paper": "m l^2 theta'' + 3 m g l sin(theta) = 3 u, as printed in the paper",
    "gymnasium": "theta'' = 3 g / (2 l) sin(theta) + 3 u / (m l^2), as in Gymnasium's Pendulum-v1",
}


def pendulum() -> Task:
    """The paper's pendulum: truth g 9.81, m 1, l 1; prior g 9.0, m 0.5, l 2.0; equation as printed.

    Reference: Miller et al. 2024 (arXiv 2403.17233), section IV.
    """
    return _wrong_everywhere("pendulum", "paper")


def pendulum_gymnasium() -> Task:
    """Like :func:`pendulum`, with the equation of Gymnasium's ``Pendulum-v1``: theta = 0 stands."""
    return _wrong_everywhere("pendulum-gymnasium", "gymnasium")


def _wrong_everywhere(name: str, equation: Literal["paper", "gymnasium"]) -> Task:
    truth, prior = Pendulum(equation=equation), Pendulum(g=9.0, m=0.5, l=2.0, equation=equation)
    description = f"{_EQUATIONS[equation]}; true g 9.81, m 1, l 1; imperfect simulator g 9, m 0.5, l 2."
    return Task(name, truth, prior, PRINTED, description, "rad, rad/s")


def pendulum_brake() -> Task:
    """A pendulum whose simulator is right but for a brake near theta = 1.2 rad, about a tenth of the volume."""
    return _wrong_in_places("pendulum-brake", LocalBrake(1.2, 0.25, 2.0 / 3.0), "a brake near theta = 1.2 rad")


def pendulum_magnet() -> Task:
    """A pendulum whose simulator is right but for a magnet at theta = -2 rad, about a sixth of the volume."""
    return _wrong_in_places("pendulum-magnet", Magnet(-2.0, 0.3, 2.8), "a magnet at theta = -2 rad")


def pendulum_stop() -> Task:
    """A pendulum whose simulator is right but for a soft stop past theta = 2.4 rad, about a tenth of the volume."""
    return _wrong_in_places("pendulum-stop", JointStop(2.4, 8.3, 1.0), "a soft stop past theta = 2.4 rad")


def _wrong_in_places(name: str, torque: nn.Module, lack: str) -> Task:
    description = f"{_EQUATIONS['paper']}; {lack} that the imperfect simulator lacks."
    return Task(name, Pendulum(extra_torque=torque), Pendulum(), LOCAL, description, "rad, rad/s")


TASKS: dict[str, Callable[[], Task]] = {
    "pendulum": pendulum,
    "pendulum-brake": pendulum_brake,
    "pendulum-magnet": pendulum_magnet,
    "pendulum-stop": pendulum_stop,
    "pendulum-gymnasium": pendulum_gymnasium,
}
"""The tasks that the command line knows by name."""
