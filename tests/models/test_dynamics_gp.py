"""The GP itself: prior, data, angles, what it notices, and its errors."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import gpytorch
import pytest
import torch
from gpytorch.constraints import GreaterThan
from gpytorch.kernels import MaternKernel, RBFKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from torch import Tensor

from torch_activegp.errors import ConfigurationError, DataError, ShapeError, SimulationError
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import (
    CachedPosterior,
    Count,
    DynamicsGP,
    FixedNoise,
    HeldNoise,
    InverseSquareNoise,
    LearnedNoise,
    NoiseSchedule,
    TheoremNoise,
)
from torch_activegp.simulators import FunctionSimulator, Pendulum, StateSpace

DOUBLE = torch.float64
Draw = Callable[[int], tuple[Tensor, Tensor, Tensor]]
Predict = Callable[[CachedPosterior, Tensor], tuple[Tensor, Tensor]]


def query(transitions: Draw, size: int = 6) -> Tensor:
    return torch.cat(transitions(size)[:2], dim=-1)


# -- the prior and the parts ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("batch_shape", [(), (2,)])
def test_the_prior_has_mean_kernel_and_output_scale(batch_shape: tuple[int, ...], transitions: Draw) -> None:
    kernel = ScaleKernel(RBFKernel(), batch_shape=torch.Size(batch_shape))
    scale = torch.tensor([0.5, 3.0])
    gp, z = DynamicsGP(SimulatorMean(Pendulum()), kernel, output_scale=scale), query(transitions)
    prior = gp(z)
    assert prior.mean.shape == (2, 6)
    assert torch.equal(prior.mean, gp.mean_module(z))
    expected = kernel(z).to_dense().expand(2, 6, 6) * scale.square()[:, None, None]
    torch.testing.assert_close(prior.covariance_matrix, expected)


def test_it_trains_with_gpytorchs_own_loop(gp: DynamicsGP, transitions: Draw) -> None:
    gp.noise_schedule = LearnedNoise()
    gp.update(*transitions(20))
    mll = gpytorch.mlls.ExactMarginalLogLikelihood(gp.likelihood, gp)
    optimizer, losses = torch.optim.Adam(gp.parameters(), lr=0.1), []
    gp.train()
    for _ in range(5):
        optimizer.zero_grad()
        loss = -mll(gp(*gp.train_inputs), gp.train_targets).sum()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    gp.eval()
    assert losses[-1] < losses[0]
    z = query(transitions)
    features = gp.posterior.features(z)
    torch.testing.assert_close(gp.posterior.loc(features), gp(z).mean.mT.detach(), rtol=0, atol=1e-8)


def test_the_noise_is_the_schedules_from_the_start(gp: DynamicsGP) -> None:
    torch.testing.assert_close(gp.posterior.noise_scale, torch.full((2,), 1e-2, dtype=DOUBLE))
    assert isinstance(gp.noise_schedule, FixedNoise)


def test_a_likelihood_that_is_given_keeps_its_noise(prior: Pendulum, transitions: Draw) -> None:
    likelihood = GaussianLikelihood()
    likelihood.noise = torch.tensor(0.3, dtype=DOUBLE)
    gp = DynamicsGP(SimulatorMean(prior), RBFKernel(), likelihood=likelihood)
    gp.update(*transitions(5))
    assert isinstance(gp.noise_schedule, LearnedNoise)
    assert gp.likelihood.noise.item() == pytest.approx(0.3, rel=1e-6)
    scheduled = DynamicsGP(SimulatorMean(prior), RBFKernel(), likelihood=GaussianLikelihood(), noise=FixedNoise(0.2))
    assert scheduled.likelihood.noise.item() == pytest.approx(0.2)


@pytest.mark.parametrize("noise_shape", [(), (2,)])
@pytest.mark.parametrize(
    "schedule", [InverseSquareNoise(), TheoremNoise(4), FixedNoise(3e-5), HeldNoise(InverseSquareNoise(), 1.5)]
)
def test_the_likelihood_follows_the_schedule(
    schedule: NoiseSchedule, noise_shape: tuple[int, ...], prior: Pendulum, transitions: Draw
) -> None:
    likelihood = GaussianLikelihood(batch_shape=torch.Size(noise_shape), noise_constraint=GreaterThan(1e-14))
    scale = torch.tensor([2.0, 2.0] if not noise_shape else [0.5, 3.0], dtype=DOUBLE)
    gp = DynamicsGP(SimulatorMean(prior), RBFKernel(), noise=schedule, likelihood=likelihood, output_scale=scale)
    for size in (1, 3, 2):
        gp.update(*transitions(size))
        expected = schedule.variance(gp.count) * scale.square()
        torch.testing.assert_close(gp.likelihood.noise.detach().reshape(-1).expand(2), expected, rtol=1e-9, atol=0)
        torch.testing.assert_close(gp.posterior.noise_scale, expected.sqrt(), rtol=1e-9, atol=0)
        gp.begin_episode()


def test_counts_of_points_episodes_and_steps(gp: DynamicsGP, transitions: Draw) -> None:
    assert gp.count == Count(0, 1, 0)
    gp.begin_episode()  # nothing to end
    assert gp.count == Count(0, 1, 0)
    gp.update(*transitions(3))
    assert gp.count == Count(3, 1, 3)
    gp.begin_episode()
    gp.begin_episode()
    assert gp.count == Count(3, 2, 0)
    gp.update(*transitions(2))
    assert gp.count == Count(5, 2, 2)


def test_beginning_an_episode_again_changes_nothing(transitions: Draw, prior: Pendulum, predict: Predict) -> None:
    for recursion in ("paper", "bayes"):
        gp = DynamicsGP(EpisodicMean(SimulatorMean(prior), recursion), RBFKernel(), noise=InverseSquareNoise())
        z = query(transitions)
        gp.update(*transitions(8))
        gp.begin_episode()
        once = predict(gp.posterior, z)
        gp.begin_episode()
        for again, first in zip(predict(gp.posterior, z), once, strict=True):
            torch.testing.assert_close(again, first, rtol=0, atol=1e-13)
        assert len(gp.mean_module.expansions) == 1


# -- data -------------------------------------------------------------------------------------------------------------


def test_data_may_come_in_any_portions_and_dtype(prior: Pendulum, transitions: Draw, predict: Predict) -> None:
    data, z, results = transitions(12), query(transitions), []
    for portions in ([12], [1] * 12, [5, 7]):
        gp = DynamicsGP(SimulatorMean(prior), MaternKernel(), noise=HeldNoise(InverseSquareNoise(), 2.0))
        for rows in zip(*(part.split(portions) for part in data), strict=True):
            gp.posterior  # noqa: B018 - so that there is something to append to
            gp.update(*rows)
        results.append(predict(gp.posterior, z))
    for result in results[1:]:
        torch.testing.assert_close(result, results[0], rtol=0, atol=1e-10)
    single = DynamicsGP(SimulatorMean(prior), MaternKernel(), noise=HeldNoise(InverseSquareNoise(), 2.0))
    single.update(*(part.float() for part in data))
    assert single.inputs.dtype == single.targets.dtype == DOUBLE
    torch.testing.assert_close(predict(single.posterior, z), results[0], rtol=0, atol=1e-3)


def test_no_transitions_are_no_change(gp: DynamicsGP, transitions: Draw) -> None:
    gp.update(*transitions(0))
    assert gp.count == Count(0, 1, 0)
    gp.update(*transitions(4))
    kept = gp.posterior
    gp.update(*transitions(0))
    assert gp.posterior is kept
    assert gp.count == Count(4, 1, 4)


def test_the_data_is_the_users_own(gp: DynamicsGP, transitions: Draw) -> None:
    data = transitions(4)
    gp.update(*data)
    before = gp.inputs.clone(), gp.targets.clone()
    for part in data:
        part.zero_()
    assert torch.equal(gp.inputs, before[0])
    assert torch.equal(gp.targets, before[1])


def test_a_failed_append_falls_back_to_the_factor(
    gp: DynamicsGP, transitions: Draw, monkeypatch: pytest.MonkeyPatch, predict: Predict
) -> None:
    gp.update(*transitions(4))
    z, kept = query(transitions), gp.posterior

    def fail(self: CachedPosterior, z: Tensor, target: Tensor) -> None:
        raise torch.linalg.LinAlgError("not positive definite")

    with monkeypatch.context() as patch:
        patch.setattr(CachedPosterior, "append", fail)
        gp.update(*transitions(2))
    assert gp.posterior is not kept
    assert gp.posterior.num_points == 6
    torch.testing.assert_close(predict(gp.posterior, z)[0], gp(z).mean.mT.detach(), rtol=0, atol=1e-8)


# -- angles -----------------------------------------------------------------------------------------------------------


def rotor(offset: float = 0.0) -> FunctionSimulator:
    """An angle that the action turns; the offset is the simulator's error, rad."""
    space = StateSpace(["angle", "speed"], [-math.pi, -9.0], [math.pi, 9.0], angles=[0])

    def turn(state: Tensor, action: Tensor) -> Tensor:
        return torch.cat([state[..., :1] + action + offset, state[..., 1:]], dim=-1)

    return FunctionSimulator(turn, space, 1, dt=0.1)


@pytest.mark.parametrize("recursion", ["paper", "bayes"])
def test_residuals_are_taken_on_the_circle(recursion: str, generator: torch.Generator) -> None:
    """The simulator is off by 0.2 rad everywhere: across the seam too, and not by 2 pi - 0.2 there."""
    truth = rotor()
    kernel = RBFKernel().double()
    kernel.lengthscale = torch.tensor(3.0, dtype=DOUBLE)
    gp = DynamicsGP(EpisodicMean(SimulatorMean(rotor(offset=-0.2)), recursion), kernel, noise=FixedNoise(1e-6))
    for _ in range(3):
        state = truth.state_space.sample((40,), generator)
        action = torch.rand(40, 1, generator=generator, dtype=DOUBLE) - 0.5
        gp.update(state, action, truth(state, action))
        gp.begin_episode()
    residual = gp.targets - gp.mean_module.base(gp.inputs)
    torch.testing.assert_close(residual, torch.tensor([0.2, 0.0], dtype=DOUBLE).expand(120, 2))
    seam = torch.tensor([[3.1, 0.0, 0.1], [-3.1, 0.0, -0.1], [3.1, 1.0, 0.2]], dtype=DOUBLE)
    predicted = gp.state_space.wrap(gp.posterior.loc(gp.posterior.features(seam)))
    difference = gp.state_space.difference(predicted, truth(seam[:, :2], seam[:, 2:]))
    assert difference.abs().max() < 5e-3
    torch.testing.assert_close(gp(seam).mean.mT, gp.posterior.loc(gp.posterior.features(seam)), rtol=0, atol=1e-8)


def test_targets_follow_a_mean_that_crosses_the_seam() -> None:
    simulator = rotor()
    simulator.register_buffer("offset", torch.tensor(0.0, dtype=DOUBLE))
    simulator.fn = lambda state, action: torch.cat([state[..., :1] + action + simulator.offset, state[..., 1:]], -1)
    gp = DynamicsGP(SimulatorMean(simulator), RBFKernel())
    state, action = torch.tensor([[3.0, 0.0]]), torch.tensor([[0.1]])
    gp.update(state, action, torch.tensor([[3.1, 0.0]]))
    simulator.offset.fill_(0.1)  # the simulator now says 3.2, which is -3.083
    features = gp.posterior.features(torch.cat([state, action], -1).double())
    residual = gp.posterior.loc(features) - features.simulator_loc
    torch.testing.assert_close(residual[0], torch.tensor([-0.1, 0.0], dtype=DOUBLE), rtol=0, atol=1e-4)
    torch.testing.assert_close(gp(features.z).mean.mT.detach(), gp.posterior.loc(features), rtol=0, atol=1e-8)


def test_without_state_space_nothing_is_unwrapped(transitions: Draw) -> None:
    gp = DynamicsGP(gpytorch.means.ZeroMean(batch_shape=torch.Size([2])), RBFKernel())
    state, action, next_state = transitions(4)
    gp.update(state, action, next_state + 100.0)
    assert gp.state_space is None
    assert torch.equal(gp.targets, next_state + 100.0)
    with_space = DynamicsGP(gpytorch.means.ConstantMean(), RBFKernel(), state_space=Pendulum().state_space)
    with_space.update(state, action, next_state)
    assert with_space.num_outputs == 2
    assert with_space.targets[:, 0].abs().max() <= math.pi


# -- what it notices --------------------------------------------------------------------------------------------------


def set_lengthscale(gp: DynamicsGP) -> None:
    gp.covar_module.base_kernel.lengthscale = 0.4


def set_outputscale(gp: DynamicsGP) -> None:
    gp.covar_module.outputscale = 3.0


def set_noise(gp: DynamicsGP) -> None:
    gp.likelihood.noise = 0.5


def set_simulator(gp: DynamicsGP) -> None:
    gp.mean_module.base_mean.simulator.g.fill_(3.0)


def set_output_scale(gp: DynamicsGP) -> None:
    gp.output_scale = torch.tensor([0.5, 2.0], dtype=DOUBLE)


def replace_kernel(gp: DynamicsGP) -> None:
    gp.covar_module = ScaleKernel(MaternKernel()).double()


def replace_base_kernel(gp: DynamicsGP) -> None:
    gp.covar_module.base_kernel = MaternKernel().double()


def load_state(gp: DynamicsGP) -> None:
    state = {key: value.clone() for key, value in gp.state_dict().items()}
    state["covar_module.raw_outputscale"] += 1.0
    gp.load_state_dict(state)


def replace_targets(gp: DynamicsGP) -> None:
    gp.set_train_data(targets=gp.train_targets + 0.3)


def replace_data(gp: DynamicsGP) -> None:
    gp.set_train_data(gp.train_inputs[0][:, :4] * 0.9, gp.train_targets[:, :4] + 0.1, strict=False)


def step_of_an_optimizer(gp: DynamicsGP) -> None:
    gp.covar_module.raw_outputscale.grad = torch.ones_like(gp.covar_module.raw_outputscale)
    torch.optim.SGD(gp.covar_module.parameters(), lr=0.7).step()


CHANGES = [
    set_lengthscale,
    set_outputscale,
    set_noise,
    set_simulator,
    set_output_scale,
    replace_kernel,
    replace_base_kernel,
    load_state,
    replace_targets,
    replace_data,
    step_of_an_optimizer,
]


@pytest.mark.parametrize("gpytorch_first", [False, True])
@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_noticed_by_both_posteriors(
    change: Callable[[DynamicsGP], None],
    begun: bool,
    gpytorch_first: bool,
    prior: Pendulum,
    transitions: Draw,
    predict: Predict,
) -> None:
    gp = DynamicsGP(EpisodicMean(SimulatorMean(prior)), ScaleKernel(RBFKernel()), noise=FixedNoise(0.1))
    gp.update(*transitions(8))
    gp.begin_episode()
    if not begun:
        gp.update(*transitions(4))
    z = gp.inputs + 0.1
    before, own_before = torch.cat(predict(gp.posterior, z)), torch.cat([gp(z).mean.mT, gp(z).variance.mT])
    torch.testing.assert_close(before, own_before.detach(), rtol=0, atol=1e-8)
    kept = gp.posterior
    change(gp)
    results = {}
    for ours in (not gpytorch_first, gpytorch_first):  # whichever is asked first must notice
        own = None if ours else gp(z)
        results[ours] = torch.cat(predict(gp.posterior, z) if own is None else [own.mean.mT, own.variance.mT])
    after = results[True]
    assert gp.posterior is not kept
    assert (after - before).abs().max() > 1e-3
    torch.testing.assert_close(after, results[False].detach(), rtol=0, atol=1e-8)
    restored = copy.deepcopy(gp)  # nothing but the parts decides
    torch.testing.assert_close(torch.cat(predict(restored.posterior, z)), after, rtol=0, atol=1e-12)


def test_it_is_not_made_anew_without_a_change(gp: DynamicsGP, transitions: Draw) -> None:
    gp.update(*transitions(5))
    kept = gp.posterior
    z = query(transitions)
    kept.features(z)
    gp(z)
    gp.state_dict()
    gp.eval()
    gp.requires_grad_(False)
    copy.deepcopy(gp)
    gp.update(*transitions(1))
    assert gp.posterior is kept


# -- errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ([(4, 2), (4, 1), (3, 2)], r"Wanted state \(n, 2\), action \(n, m\) and next_state \(n, 2\), found \(4, 2\)"),
        ([(2,), (1,), (2,)], r"found \(2,\), \(1,\) and \(2,\)"),
        ([(4, 3), (4, 1), (4, 3)], r"Wanted 2 states and as many actions as states, found \(4, 3\) and \(4, 1\)"),
        ([(4, 2), (3, 1), (4, 2)], r"as many actions as states, found \(4, 2\) and \(3, 1\)"),
    ],
)
def test_shapes_that_do_not_fit(shapes: list[tuple[int, ...]], message: str, gp: DynamicsGP) -> None:
    with pytest.raises(ShapeError, match=message):
        gp.update(*map(torch.zeros, shapes))
    assert gp.num_points == 0


def test_inputs_that_differ_from_those_before(transitions: Draw) -> None:
    gp = DynamicsGP(gpytorch.means.ZeroMean(batch_shape=torch.Size([2])), RBFKernel())
    gp.update(*transitions(2))
    with pytest.raises(ShapeError, match="Wanted 3 inputs as in the data so far, found 4"):
        gp.update(torch.zeros(1, 2), torch.zeros(1, 2), torch.zeros(1, 2))


@pytest.mark.parametrize("part", [0, 1, 2])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_data_that_is_not_finite(value: float, part: int, gp: DynamicsGP, transitions: Draw) -> None:
    data = transitions(5)
    data[part][3, 0] = value
    with pytest.raises(DataError, match=r"found NaN or infinity in row 3 of 5\. Drop such rows"):
        gp.update(*data)
    assert gp.count == Count(0, 1, 0)


def test_a_simulator_that_diverges_is_named_with_its_point(transitions: Draw) -> None:
    def diverge(state: Tensor, action: Tensor) -> Tensor:
        return torch.where(action > 0.5, torch.nan, state)

    gp = DynamicsGP(EpisodicMean(SimulatorMean(FunctionSimulator(diverge, 1, 1, dt=0.1))), RBFKernel())
    state, action = torch.tensor([[0.25], [0.75]]), torch.tensor([[0.0], [1.0]])
    with pytest.raises(SimulationError, match=r"prediction of the mean at z = \[0\.75, 1\.0\], found \[nan\]\. Mend"):
        gp.update(state, action, state)
    assert gp.count == Count(0, 1, 0)


def test_a_schedule_below_the_likelihoods_limit(prior: Pendulum, transitions: Draw) -> None:
    mean, kernel = SimulatorMean(prior), RBFKernel()
    with pytest.raises(ConfigurationError, match=r"variance of 1e-05, below the likelihood's limit 0\.0001\. Give the"):
        DynamicsGP(mean, kernel, noise=FixedNoise(1e-5), likelihood=GaussianLikelihood())
    gp = DynamicsGP(mean, kernel, noise=InverseSquareNoise(), likelihood=GaussianLikelihood())
    gp.update(*transitions(99))
    with pytest.raises(ConfigurationError, match="noise_constraint=GreaterThan"):
        gp.update(*transitions(2))


def test_the_number_of_outputs_must_be_known_and_agree(prior: Pendulum) -> None:
    with pytest.raises(ConfigurationError, match=r"outputs is unknown: ConstantMean has no batch_shape\. Pass state_s"):
        DynamicsGP(gpytorch.means.ConstantMean(), RBFKernel())
    mean, three = SimulatorMean(prior), torch.Size([3])
    with pytest.raises(
        ShapeError, match=r"Wanted mean_module with batch_shape \(\) or \(2,\) for 2 outputs, found \(3,"
    ):
        DynamicsGP(gpytorch.means.ZeroMean(batch_shape=three), RBFKernel(), state_space=prior.state_space)
    with pytest.raises(ShapeError, match=r"Wanted covar_module with batch_shape .* for 2 outputs, found \(3,\)"):
        DynamicsGP(mean, RBFKernel(batch_shape=three))
    with pytest.raises(ShapeError, match=r"Wanted output_scale of shape \(2,\) for 2 outputs, found \(1,\)"):
        DynamicsGP(mean, RBFKernel(), output_scale=torch.ones(1))


@pytest.mark.parametrize("scale", [[1.0, -1.0], [0.0, 1.0], [float("inf"), 1.0]])
def test_an_output_scale_that_is_none_is_refused(scale: list[float]) -> None:
    with pytest.raises(ConfigurationError, match="positive, finite output scales"):
        DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel(), output_scale=torch.tensor(scale))
