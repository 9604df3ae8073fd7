"""The data of the GP: gpytorch's view of it, and what survives saving, copying and moving."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable

import gpytorch
import pytest
import torch
from gpytorch.kernels import Kernel, MaternKernel, RBFKernel, ScaleKernel
from torch import Tensor

from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, InverseSquareNoise, LearnedNoise, NoiseSchedule, scaled_rbf
from torch_activegp.simulators import Pendulum

DOUBLE = torch.float64
Draw = Callable[[int], tuple[Tensor, Tensor, Tensor]]


def make(recursion: str = "paper", noise: NoiseSchedule | None = None, kernel: Kernel | None = None) -> DynamicsGP:
    mean = EpisodicMean(SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0)), recursion)
    return DynamicsGP(mean, kernel or ScaleKernel(RBFKernel(ard_num_dims=3)), noise=noise or InverseSquareNoise())


def trained(transitions: Draw, **options: object) -> DynamicsGP:
    """Three episodes, with other hyper-parameters in the second."""
    gp = make(**options)
    for episode in range(3):
        gp.update(*transitions(6))
        gp.begin_episode()
        if episode == 0:
            with torch.no_grad():
                for parameter in gp.covar_module.parameters():
                    parameter.add_(0.4)
    return gp


def quantities(gp: DynamicsGP, z: Tensor) -> list[Tensor]:
    features = gp.posterior.features(z)
    return [getattr(gp.posterior, name)(features) for name in ("loc", "prior_loc", "scale")]


def test_gpytorch_sees_a_batch_of_views(gp: DynamicsGP, transitions: Draw) -> None:
    assert gp.train_inputs is None
    assert gp.train_targets is None
    state, action, next_state = transitions(5)
    gp.update(state, action, next_state)
    (inputs,) = gp.train_inputs
    assert inputs.shape == (2, 5, 3)
    assert inputs.data_ptr() == gp.inputs.data_ptr()  # stored once
    assert torch.equal(inputs[1], torch.cat([state, action], dim=-1))
    assert torch.equal(gp.train_targets, gp.targets.mT)


@pytest.mark.parametrize("batched", [True, False])
def test_data_set_as_gpytorch_does(batched: bool, gp: DynamicsGP, transitions: Draw) -> None:
    state, action, next_state = transitions(5)
    reference = copy.deepcopy(gp)
    reference.update(state, action, next_state)
    z = torch.cat([state, action], dim=-1)
    gp.set_train_data(z.expand(2, -1, -1) if batched else z, reference.train_targets, strict=False)
    for ours, expected in zip(quantities(gp, z), quantities(reference, z), strict=True):
        torch.testing.assert_close(ours, expected, rtol=0, atol=1e-13)
    with pytest.raises(RuntimeError, match="Cannot modify"):
        gp.set_train_data(targets=torch.zeros(2, 3, dtype=DOUBLE))


def test_data_set_at_the_start_of_an_episode_is_used(transitions: Draw) -> None:
    gp = trained(transitions)
    z = torch.cat(transitions(4)[:2], dim=-1)
    loc, prior_loc, _ = quantities(gp, z)
    assert torch.equal(loc, prior_loc)
    gp.set_train_data(gp.train_inputs, gp.train_targets + 0.5)
    loc, after, _ = quantities(gp, z)
    torch.testing.assert_close(after, prior_loc, rtol=0, atol=1e-13)
    assert (loc - prior_loc).abs().max() > 1e-2
    torch.testing.assert_close(loc, gp(z).mean.mT.detach(), rtol=0, atol=1e-8)


@pytest.mark.parametrize("kernel", ["shared", "an output"])
@pytest.mark.parametrize("recursion", ["paper", "bayes"])
def test_a_state_dict_makes_a_fresh_model_the_same_bit_for_bit(recursion: str, kernel: str, transitions: Draw) -> None:
    def build() -> Kernel:
        return MaternKernel() if kernel == "shared" else MaternKernel(batch_shape=torch.Size([2]))

    gp = trained(transitions, recursion=recursion, kernel=build())
    gp.mean_module.base_mean.simulator.g.fill_(8.5)
    fresh = make(recursion, kernel=build())
    file = io.BytesIO()
    torch.save(gp.state_dict(), file)
    file.seek(0)
    fresh.load_state_dict(torch.load(file, weights_only=True))
    assert fresh.count == gp.count
    data, z = transitions(3), torch.cat(transitions(9)[:2], dim=-1)
    for ours, expected in zip(quantities(fresh, z), quantities(gp, z), strict=True):
        assert torch.equal(ours, expected)
    for model in (gp, fresh):  # and so they go on
        model.update(*data)
    for ours, expected in zip(quantities(fresh, z), quantities(gp, z), strict=True):
        assert torch.equal(ours, expected)


def test_a_state_dict_replaces_what_a_model_had_learned(transitions: Draw) -> None:
    gp, other = trained(transitions), trained(transitions)
    other.update(*transitions(20))
    z = torch.cat(transitions(9)[:2], dim=-1)
    assert not torch.equal(quantities(other, z)[0], quantities(gp, z)[0])
    other(z)  # fills gpytorch's own cache
    other.load_state_dict(gp.state_dict())
    assert torch.equal(quantities(other, z)[0], quantities(gp, z)[0])
    assert torch.equal(other(z).mean, gp(z).mean)
    empty = make()
    other.load_state_dict(empty.state_dict())
    assert other.num_points == 0
    assert len(other.mean_module.expansions) == 0
    assert torch.equal(quantities(other, z)[0], quantities(empty, z)[0])


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda gp: pickle.loads(pickle.dumps(gp))])
def test_copies_agree_and_are_apart(duplicate: Callable[[DynamicsGP], DynamicsGP], transitions: Draw) -> None:
    low = torch.tensor([-3.0, -8.0, -2.0], dtype=DOUBLE)
    gp = trained(transitions, kernel=scaled_rbf(low, -low), noise=LearnedNoise())  # with priors
    z = torch.cat(transitions(9)[:2], dim=-1)
    before = quantities(gp, z)
    gp(z)
    other = duplicate(gp)
    for ours, expected in zip(quantities(other, z), before, strict=True):
        assert torch.equal(ours, expected)
    other.update(*transitions(5))
    other.covar_module.outputscale = 4.0
    assert gp.num_points == 18
    for ours, expected in zip(quantities(gp, z), before, strict=True):
        assert torch.equal(ours, expected)


def test_moving_to_another_dtype_moves_everything(transitions: Draw) -> None:
    gp = trained(transitions, noise=FixedNoise(1e-2))
    z = torch.cat(transitions(9)[:2], dim=-1)
    before = quantities(gp, z)
    gp(z)
    gp.to(torch.float32)
    assert gp.count.points == 18
    single = quantities(gp, z.float())
    assert all(value.dtype == torch.float32 for value in single)
    assert gp(z.float()).mean.dtype == torch.float32
    torch.testing.assert_close(single, before, rtol=0, atol=2e-3, check_dtype=False)
    gp.update(*transitions(2))
    assert gp.inputs.dtype == torch.float32


def test_a_state_dict_is_loaded_in_the_models_own_dtype(transitions: Draw) -> None:
    gp = trained(transitions)
    single = make().to(torch.float32)
    single.load_state_dict(gp.state_dict())
    assert single.inputs.dtype == single.mean_module.expansions[0].weights.dtype == torch.float32


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_moving_to_another_device_moves_everything(transitions: Draw) -> None:
    gp = trained(transitions)
    z = torch.cat(transitions(9)[:2], dim=-1)
    before = quantities(gp, z)
    fresh = make().to("cuda")
    fresh.load_state_dict(gp.state_dict())
    gp.to("cuda")
    for model in (gp, fresh):
        moved = quantities(model, z.cuda())
        assert all(value.device.type == "cuda" for value in moved)
        for ours, expected in zip(moved, before, strict=True):
            torch.testing.assert_close(ours.cpu(), expected, rtol=0, atol=1e-9)
        model.update(*transitions(3))
        assert model.inputs.device.type == "cuda"
        model.begin_episode()


def test_gpytorchs_settings_do_not_matter(gp: DynamicsGP, transitions: Draw) -> None:
    gp.update(*transitions(5))
    z = torch.cat(transitions(4)[:2], dim=-1)
    with gpytorch.settings.prior_mode(True):
        torch.testing.assert_close(gp(z).mean, gp.mean_module(z))
    expected = quantities(gp, z)
    gp.forget()
    with gpytorch.settings.lazily_evaluate_kernels(False), gpytorch.settings.fast_computations(False, False, False):
        torch.testing.assert_close(quantities(gp, z), expected, rtol=0, atol=1e-13)
