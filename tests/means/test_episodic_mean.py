"""The chain of episodic priors; tests/test_theory.py compares it with the literal recursion."""

from __future__ import annotations

import copy
import pickle

import gpytorch
import pytest
import torch
from gpytorch.kernels import RBFKernel
from torch import Tensor

from torch_activegp.errors import ConfigurationError
from torch_activegp.means import EpisodicMean, KernelExpansion, SimulatorMean
from torch_activegp.simulators import Pendulum

DOUBLE = torch.float64


def points(generator: torch.Generator, *shape: int) -> Tensor:
    return torch.rand(*shape, generator=generator, dtype=DOUBLE)


def rbf_kernel(lengthscale: float = 0.7) -> RBFKernel:
    kernel = RBFKernel().double()
    kernel.lengthscale = torch.tensor(lengthscale, dtype=DOUBLE)
    return kernel


def episodic(recursion: str = "paper") -> EpisodicMean:
    return EpisodicMean(SimulatorMean(Pendulum()), recursion=recursion)


@pytest.mark.parametrize("recursion", ["paper", "bayes"])
def test_the_first_episode_has_the_base_mean(recursion: str, generator: torch.Generator) -> None:
    mean, z = episodic(recursion), points(generator, 5, 3)
    expected = mean.base_mean.predict(z)
    for value in (mean.base(z), mean.reference(z), mean.predict(z), mean(z).mT, mean(z.expand(2, -1, -1)).mT):
        assert torch.equal(value, expected)
    assert mean.num_outputs == 2
    assert mean.inner(rbf_kernel(), z) is None
    assert mean.outer(rbf_kernel(), z) == []


def test_an_unknown_recursion_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="Wanted recursion 'paper' or 'bayes', found 'bayse'"):
        episodic("bayse")


def test_the_number_of_outputs_must_be_known() -> None:
    with pytest.raises(ConfigurationError, match=r"ConstantMean does not say how many outputs it has\. Pass num_outp"):
        EpisodicMean(gpytorch.means.ConstantMean())
    assert EpisodicMean(gpytorch.means.ConstantMean(), num_outputs=3).batch_shape == (3,)
    assert EpisodicMean(gpytorch.means.ConstantMean(batch_shape=torch.Size([4]))).num_outputs == 4


def test_a_base_without_batch_shape_serves_all_outputs(generator: torch.Generator) -> None:
    base = gpytorch.means.LinearMean(3).double()
    mean, z = EpisodicMean(base, num_outputs=2), points(generator, 5, 3)
    assert torch.equal(mean.predict(z), base(z).unsqueeze(-1).expand(5, 2))


@pytest.mark.parametrize("recursion", ["paper", "bayes"])
def test_the_posterior_becomes_the_reference(recursion: str, generator: torch.Generator) -> None:
    mean, kernel = episodic(recursion), rbf_kernel()
    z, centers, weights = points(generator, 5, 3), points(generator, 4, 3), points(generator, 1, 4, 2)
    mean.advance(kernel, centers, weights)
    added = kernel(z, centers).to_dense().detach() @ weights[0]
    torch.testing.assert_close(mean.reference(z), mean.base(z) + added)
    conditioning = mean.base(z) if recursion == "bayes" else mean.base(z) + added
    torch.testing.assert_close(mean.predict(z), conditioning)
    torch.testing.assert_close(mean(z), conditioning.mT)
    torch.testing.assert_close(mean(z.expand(3, 2, -1, -1)), conditioning.mT.expand(3, -1, -1))


def test_each_output_may_have_its_own_inputs(generator: torch.Generator) -> None:
    mean = episodic()
    mean.advance(rbf_kernel(), points(generator, 4, 3), points(generator, 1, 4, 2))
    x = points(generator, 2, 5, 3)
    values = mean(x)
    for output in range(2):
        torch.testing.assert_close(values[output], mean.predict(x[output])[:, output])


def test_an_equal_kernel_leaves_one_term(generator: torch.Generator) -> None:
    mean, centers = episodic(), points(generator, 9, 3)
    for episode in range(1, 4):
        mean.advance(rbf_kernel(), centers[: 3 * episode], points(generator, 1, 3 * episode, 2))
        assert len(mean.expansions) == 1
    assert mean.inner(rbf_kernel(), centers) is mean.expansions[0]
    assert mean.outer(rbf_kernel(), centers) == []


def test_a_changed_kernel_keeps_a_term(generator: torch.Generator) -> None:
    mean, centers, z = episodic(), points(generator, 4, 3), points(generator, 5, 3)
    mean.advance(rbf_kernel(0.7), centers, points(generator, 1, 4, 2))
    before = mean.reference(z)
    weights = points(generator, 1, 4, 2)
    mean.advance(rbf_kernel(0.3), centers, weights)
    assert len(mean.expansions) == 2
    torch.testing.assert_close(mean.reference(z), before + KernelExpansion(rbf_kernel(0.3), centers, weights)(z))
    assert mean.inner(rbf_kernel(0.7), centers) is None  # only the last term can be merged
    assert mean.outer(rbf_kernel(0.3), centers) == [mean.expansions[0]]


def test_a_term_at_other_points_is_kept(generator: torch.Generator) -> None:
    mean, z = episodic(), points(generator, 5, 3)
    mean.advance(rbf_kernel(), points(generator, 4, 3), points(generator, 1, 4, 2))
    before, centers, weights = mean.reference(z), points(generator, 6, 3), points(generator, 1, 6, 2)
    assert mean.inner(rbf_kernel(), centers) is None
    mean.advance(rbf_kernel(), centers, weights)
    torch.testing.assert_close(mean.reference(z), before + KernelExpansion(rbf_kernel(), centers, weights)(z))


def test_bayes_keeps_only_the_last_posterior(generator: torch.Generator) -> None:
    mean = episodic("bayes")
    for lengthscale in (0.7, 0.3):
        mean.advance(rbf_kernel(lengthscale), points(generator, 4, 3), points(generator, 1, 4, 2))
        assert len(mean.expansions) == 1
        assert mean.expansions[0].kernel.lengthscale.item() == pytest.approx(lengthscale)


def test_gradients_reach_the_query_and_the_simulator(generator: torch.Generator) -> None:
    mean = EpisodicMean(SimulatorMean(Pendulum(trainable=True)))
    mean.advance(rbf_kernel(), points(generator, 4, 3), points(generator, 1, 4, 2))
    assert torch.autograd.gradcheck(mean.predict, points(generator, 3, 3).requires_grad_())
    mean(points(generator, 3, 3)).sum().backward()
    gradients = {name: p.grad for name, p in mean.named_parameters() if p.requires_grad}
    assert set(gradients) == {f"base_mean.simulator.{name}" for name in "gml"}
    assert all(value is not None for value in gradients.values())


def test_pickle_deepcopy_and_state_dict_keep_the_numbers(generator: torch.Generator) -> None:
    mean, z = episodic(), points(generator, 5, 3)
    mean.advance(rbf_kernel(0.7), points(generator, 4, 3), points(generator, 1, 4, 2))
    mean.advance(rbf_kernel(0.3), points(generator, 6, 3), points(generator, 1, 6, 2))
    fresh = episodic()
    fresh.allocate(rbf_kernel(), [(term.centers.shape, term.weights.shape) for term in mean.expansions])
    fresh.load_state_dict(mean.state_dict())
    for other in (fresh, pickle.loads(pickle.dumps(mean)), copy.deepcopy(mean)):
        assert torch.equal(other.predict(z), mean.predict(z))
