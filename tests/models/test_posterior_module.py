"""The posterior as a TensorDict module."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictSequential
from torch import Tensor

from torch_activegp import keys
from torch_activegp.errors import ConfigurationError
from torch_activegp.models import DynamicsGP, PosteriorModule

DOUBLE = torch.float64
Draw = Callable[[int], tuple[Tensor, Tensor, Tensor]]


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("batch", [(), (5,), (2, 3), (0,)])
def test_it_writes_every_quantity(
    batch: tuple[int, ...], dtype: torch.dtype, gp: DynamicsGP, transitions: Draw
) -> None:
    gp.output_scale = torch.tensor([0.5, 3.0], dtype=DOUBLE)
    gp.apply_schedule()
    gp.update(*transitions(8))
    parts = transitions(torch.Size(batch).numel())[:2]
    state, action = (part.to(dtype).reshape(*batch, part.shape[-1]) for part in parts)
    module = PosteriorModule(gp, out_keys=keys.POSTERIOR_KEYS)
    result = module(TensorDict({"state": state, "action": action}, batch_size=batch))
    z = torch.cat([state, action], dim=-1).to(DOUBLE).reshape(-1, 3)
    features = gp.posterior.features(z)
    expected = {
        "loc": gp.posterior.loc(features),
        "scale": gp.posterior.scale(features),
        "prior_loc": gp.mean_module.predict(z),
        "simulator_loc": gp.mean_module.predict(z),
        "noise_scale": torch.tensor([0.5, 3.0], dtype=DOUBLE).expand(len(z), 2) * 1e-2,
        "signal_scale": torch.tensor([0.5, 3.0], dtype=DOUBLE).expand(len(z), 2),
    }
    assert set(expected) == set(keys.POSTERIOR_KEYS)
    for key, value in expected.items():
        assert result[key].dtype == DOUBLE
        torch.testing.assert_close(result[key], value.reshape(*batch, 2), rtol=0, atol=1e-13)


def test_it_meets_other_modules_through_its_keys(gp: DynamicsGP, transitions: Draw) -> None:
    gp.update(*transitions(8))
    state, action, _ = transitions(4)
    module = PosteriorModule(gp, in_keys=[("agent", "x"), "u"], out_keys=["scale"])
    assert module.in_keys == [("agent", "x"), "u"]
    assert module.out_keys == ["scale"]
    result = TensorDictSequential(module)(TensorDict({"agent": {"x": state}, "u": action}, batch_size=[4]))
    features = gp.posterior.features(torch.cat([state, action], dim=-1))
    assert torch.equal(result["scale"], gp.posterior.scale(features))
    assert "loc" not in result.keys()


def test_it_follows_the_gp(gp: DynamicsGP, transitions: Draw) -> None:
    module, (state, action, _) = PosteriorModule(gp), transitions(4)
    tensordict = TensorDict({"state": state, "action": action}, batch_size=[4])
    before = module(tensordict.clone())["scale"]
    gp.update(state, action, state)
    assert bool((module(tensordict.clone())["scale"] < 0.1 * before).all())


@pytest.mark.parametrize("name", keys.POSTERIOR_KEYS[:4])
def test_gradients_reach_state_and_action(name: str, gp: DynamicsGP, transitions: Draw) -> None:
    gp.update(*transitions(8))
    module, (state, action, _) = PosteriorModule(gp, out_keys=[name]), transitions(3)

    def quantity(state: Tensor, action: Tensor) -> Tensor:
        return module(TensorDict({"state": state, "action": action}, batch_size=[3]))[name]

    assert torch.autograd.gradcheck(quantity, ((state / 2).requires_grad_(), (action / 2).requires_grad_()))


def test_an_unknown_quantity_is_refused(gp: DynamicsGP) -> None:
    with pytest.raises(ConfigurationError, match=r"Wanted out_keys of \('loc', 'scale', .*\), found \['mean'\]"):
        PosteriorModule(gp, out_keys=["loc", "mean"])


def test_it_pickles_with_its_gp(gp: DynamicsGP, transitions: Draw) -> None:
    gp.update(*transitions(8))
    module, (state, action, _) = PosteriorModule(gp), transitions(4)
    tensordict = TensorDict({"state": state, "action": action}, batch_size=[4])
    copied = pickle.loads(pickle.dumps(module))
    assert torch.equal(copied(tensordict.clone())["loc"], module(tensordict.clone())["loc"])
