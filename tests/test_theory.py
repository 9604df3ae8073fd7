"""What the method rests on, as claims that can fail; every formula is written out here, without the package.

The paper is Miller, Thorpe, Topcu 2024, arXiv 2403.17233. Srinivas et al. 2010 (arXiv 0912.3995) is the source of the
bound by information gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import pytest
import torch
from gpytorch.kernels import MaternKernel, RBFKernel
from torch import Tensor

from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, InverseSquareNoise, NoiseSchedule, TheoremNoise
from torch_activegp.simulators import Pendulum

DOUBLE = torch.float64
LENGTHSCALE = torch.tensor([0.8, 3.0, 2.0], dtype=DOUBLE)
Kernel = Callable[[Tensor, Tensor], Tensor]


def rbf(a: Tensor, b: Tensor, lengthscale: Tensor = LENGTHSCALE) -> Tensor:
    return torch.exp(-((a[:, None] - b[None]) / lengthscale).square().sum(-1) / 2)


def make(noise: NoiseSchedule, recursion: str = "paper") -> DynamicsGP:
    kernel = RBFKernel(ard_num_dims=3).double()
    kernel.lengthscale = LENGTHSCALE.unsqueeze(0)
    mean = EpisodicMean(SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0)), recursion)
    return DynamicsGP(mean, kernel, noise=noise)


def points(size: int, generator: torch.Generator) -> Tensor:
    pendulum = Pendulum()
    state = pendulum.state_space.sample((size,), generator)
    return torch.cat([state, pendulum.action_space.sample((size,), generator)], dim=-1)


def observe(gp: DynamicsGP, z: Tensor, noise: Tensor | float = 0.0) -> None:
    state, action = z[:, :2], z[:, 2:]
    gp.update(state, action, Pendulum().step(state, action) + noise)


def variance(gp: DynamicsGP, z: Tensor) -> Tensor:
    """Of the first output; both have the same kernel."""
    return gp.posterior.variance(gp.posterior.features(z))[:, 0]


# -- the posterior variance -------------------------------------------------------------------------------------------


def test_the_variance_update_lemma(generator: torch.Generator) -> None:
    """sigma_{n+1}^2(z) = sigma_n^2(z) - cov_n(z, z_{n+1})^2 / (sigma_n^2(z_{n+1}) + sigma^2) at held noise."""
    noise, data, z = 0.03, points(12, generator), points(50, generator)
    gp = make(FixedNoise(noise))
    observe(gp, data[:4])
    for n in range(4, 12):
        new = data[n : n + 1]
        system = rbf(data[:n], data[:n]) + noise * torch.eye(n, dtype=DOUBLE)
        covariance = rbf(z, new) - rbf(z, data[:n]) @ torch.linalg.solve(system, rbf(data[:n], new))
        before, at_new = variance(gp, z), variance(gp, new)
        observe(gp, new)
        expected = before - covariance[:, 0].square() / (at_new + noise)
        torch.testing.assert_close(variance(gp, z), expected, rtol=0, atol=1e-12)
        torch.testing.assert_close(variance(gp, new), at_new * noise / (at_new + noise), rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("matern", [False, True])
@pytest.mark.parametrize("noise", [FixedNoise(0.01), FixedNoise(1e-6), InverseSquareNoise(), TheoremNoise(5)])
def test_the_variance_never_grows(noise: NoiseSchedule, matern: bool, generator: torch.Generator) -> None:
    gp, z = make(noise), points(200, generator)
    if matern:
        gp.covar_module = MaternKernel(nu=1.5).double()
    before = variance(gp, z)
    for _ in range(3):
        for _ in range(5):
            observe(gp, points(1, generator))
            after = variance(gp, z)
            assert bool((after <= before + 1e-12).all())
            assert after.sum() < before.sum()
            before = after
        gp.begin_episode()
        torch.testing.assert_close(variance(gp, z), before, rtol=0, atol=1e-12)


# -- the theorem ------------------------------------------------------------------------------------------------------


def test_the_maximum_variance_falls_as_the_theorems_noise(generator: torch.Generator) -> None:
    """The rate on a finite set Z, when the point of largest variance is sampled each time.

    This is the bound that is tested, with its proof; the paper's own constants are not reproduced here. Let M_T be the
    largest variance over Z after T points, with noise T^-2 = ((tau - 1) N + n)^-2. The noise only falls and points are
    only added, so M_T never grows. Where the maximiser of step t was sampled before, M_t is at most the noise t^-2 (a
    point that was seen has variance at most k s / (k + s) <= s). Among the |Z| steps T - |Z| + 1, ..., T at most
    |Z| - 1 can have a maximiser that is new (one point was sampled at step 0), so one of them has not, and

        M_T <= (T - |Z| + 1)^-2 for all T >= |Z|.

    It holds for any kernel and implies consistency: the variance vanishes everywhere on Z, at the rate of the noise.
    """
    size, length, episodes = 12, 10, 8
    z = points(size, generator)
    gp = make(TheoremNoise(length))
    checked, maxima = 0, [float(variance(gp, z).max())]
    for _ in range(episodes):
        for _ in range(length):
            observe(gp, z[variance(gp, z).argmax()].unsqueeze(0))
            maxima.append(float(variance(gp, z).max()))
            count = gp.num_points
            assert maxima[-1] <= maxima[-2] + 1e-12
            if count >= size:
                assert maxima[-1] <= (count - size + 1) ** -2.0
                checked += 1
        gp.begin_episode()
    assert checked == episodes * length - size + 1
    assert gp.likelihood.noise[0].item() == pytest.approx((episodes * length) ** -2.0)


@pytest.mark.parametrize("noise", [1.0, 0.1, 1e-3])
def test_the_maximum_variance_is_bounded_by_the_information_gain(noise: float, generator: torch.Generator) -> None:
    """At held noise s, T log(1 + M_T / s) <= sum_t log(1 + M_t / s) = 2 I_T <= 2 gamma_T.

    So M_T <= s (e^(2 gamma_T / T) - 1). I_T = log det(I + K_T / s) / 2 is the information that the samples carry
    (Srinivas et al. 2010, Lemma 5.3), and on a finite Z, where each point is sampled at most T times,
    gamma_T <= log det(I + T K_Z / s) / 2. Since x <= c log(1 + x / s) for 0 <= x <= 1 with c = 1 / log(1 + 1 / s), it
    follows for a kernel of unit variance that M_T <= 2 gamma_T / (T log(1 + 1 / s)).
    """
    z = points(15, generator)
    gp, gains, data = make(FixedNoise(noise)), [], []
    for count in range(1, 61):
        largest = variance(gp, z)
        data.append(z[largest.argmax()])
        gains.append(math.log1p(float(largest.max()) / noise))
        observe(gp, data[-1].unsqueeze(0))
        seen = torch.stack(data)
        information = torch.logdet(torch.eye(count, dtype=DOUBLE) + rbf(seen, seen) / noise).item()
        assert sum(gains) == pytest.approx(information, rel=1e-6)
        bound = torch.logdet(torch.eye(15, dtype=DOUBLE) + count * rbf(z, z) / noise).item()
        assert information <= bound * (1 + 1e-9)
        maximum = float(variance(gp, z).max())
        assert maximum <= noise * math.expm1(bound / count)
        assert maximum <= bound / (count * math.log1p(1 / noise))


# -- the chain of priors ----------------------------------------------------------------------------------------------


def literal_recursion(
    episodes: list[tuple[Tensor, Tensor, Tensor]], base: Callable[[Tensor], Tensor], noises: list[float], bayes: bool
) -> tuple[Callable[[Tensor], Tensor], Callable[[Tensor], Tensor]]:
    """The posterior mean and the prior of the last episode, as functions that nest one posterior in the next.

    Args:
        episodes: points, targets and length-scale of each episode; an episode is conditioned on all points so far.
        base: p0.
        noises: the noise variance of each episode.
        bayes: condition on p0 instead of on the last posterior.
    """
    inputs, targets, mean, prior = torch.zeros(0, 3), torch.zeros(0, 2), base, base
    for (z, y, lengthscale), noise in zip(episodes, noises, strict=True):
        inputs, targets, prior = torch.cat([inputs, z]), torch.cat([targets, y]), mean
        conditioned = base if bayes else prior
        system = rbf(inputs, inputs, lengthscale) + noise * torch.eye(len(inputs), dtype=DOUBLE)
        alpha = torch.linalg.solve(system, targets - conditioned(inputs))

        def mean(
            query: Tensor,
            m: Callable = conditioned,
            Z: Tensor = inputs,
            alpha: Tensor = alpha,
            scale: Tensor = lengthscale,
        ) -> Tensor:
            return m(query) + rbf(query, Z, scale) @ alpha

    return mean, prior


@pytest.mark.parametrize("changes", [False, True])
@pytest.mark.parametrize("recursion", ["paper", "bayes"])
@pytest.mark.parametrize("noise", [FixedNoise(0.05), InverseSquareNoise()])
def test_the_nested_priors_collapse(
    noise: NoiseSchedule, recursion: str, changes: bool, generator: torch.Generator
) -> None:
    """m_tau and mu equal the literal recursion to 1e-12, also where length-scales change between episodes."""
    gp, query, length = make(noise, recursion), points(40, generator), 8
    episodes, noises = [], []
    for tau in range(5):
        lengthscale = LENGTHSCALE * (1.0 + 0.2 * tau * changes)
        gp.covar_module.lengthscale = lengthscale.unsqueeze(0)
        z = points(length, generator)
        for row in z.split(1):
            observe(gp, row)
            assert gp.posterior.num_points == gp.num_points  # queries in between: points are appended where they can be
        episodes.append((z, gp.targets[-length:].clone(), gp.covar_module.lengthscale.detach()[0].clone()))
        noises.append(noise.variance(gp.count))
        mean, prior = literal_recursion(episodes, gp.mean_module.base, noises, recursion == "bayes")
        features = gp.posterior.features(query)
        torch.testing.assert_close(gp.posterior.loc(features), mean(query), rtol=0, atol=1e-12)
        torch.testing.assert_close(gp.posterior.prior_loc(features), prior(query), rtol=0, atol=1e-12)
        gp.begin_episode()
        torch.testing.assert_close(gp.mean_module.reference(query), mean(query), rtol=0, atol=1e-12)
        assert len(gp.mean_module.expansions) == (tau + 1 if changes and recursion == "paper" else 1)


@pytest.mark.parametrize("recursion", ["paper", "bayes"])
@pytest.mark.parametrize("noise", [FixedNoise(0.3), InverseSquareNoise()])
def test_the_discrepancy_is_zero_before_the_first_step(
    noise: NoiseSchedule, recursion: str, generator: torch.Generator
) -> None:
    """mu_{tau, 0} = mu_{tau - 1, N} = m_tau, however large the noise."""
    gp, query = make(noise, recursion), points(40, generator)
    for _ in range(4):
        features = gp.posterior.features(query)
        discrepancy = gp.posterior.loc(features) - gp.posterior.prior_loc(features)
        assert discrepancy.abs().max() <= 1e-12
        observe(gp, points(6, generator))
        features = gp.posterior.features(query)
        assert (gp.posterior.loc(features) - gp.posterior.prior_loc(features)).abs().max() > 1e-3
        gp.begin_episode()


def test_without_noise_both_recursions_agree(generator: torch.Generator) -> None:
    """They differ by the noise: a residual of interpolation is regressed again, and there is none."""
    rounds, query = [points(10, generator) for _ in range(4)], points(40, generator)
    differences = []
    for noise in (1e-1, 1e-3, 1e-5, 1e-7):
        models = {recursion: make(FixedNoise(noise), recursion) for recursion in ("paper", "bayes")}
        for z in rounds:
            for gp in models.values():
                observe(gp, z)
                gp.posterior  # noqa: B018
            for gp in models.values():
                gp.begin_episode()
        locs = [gp.posterior.loc(gp.posterior.features(query)) for gp in models.values()]
        differences.append(float((locs[0] - locs[1]).abs().max()))
    assert differences[0] > 1e-2
    assert all(later < 0.1 * earlier for earlier, later in pairwise(differences[1:]))
    assert differences[-1] < 1e-5


def test_with_noise_the_papers_recursion_over_fits(generator: torch.Generator) -> None:
    """Iterated regularisation of 300 points with noise of standard deviation 0.2 and matched variance."""
    query = points(500, generator)
    rounds = [(points(10, generator), 0.2 * torch.randn(10, 2, generator=generator, dtype=DOUBLE)) for _ in range(30)]
    truth = Pendulum().step(query[:, :2], query[:, 2:])
    errors = {}
    for recursion in ("paper", "bayes"):
        gp = make(FixedNoise(0.04), recursion)
        for z, noise in rounds:
            observe(gp, z, noise)
            gp.begin_episode()
        loc = gp.posterior.loc(gp.posterior.features(query))
        errors[recursion] = float(gp.state_space.difference(loc, truth).square().mean())
    assert errors["paper"] > 1.5 * errors["bayes"]
