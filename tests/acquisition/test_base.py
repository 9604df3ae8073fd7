"""What every acquisition function keeps: shapes, dtypes, keys, gradients, saving."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictSequential

from torch_activegp import keys
from torch_activegp.acquisition import (
    AcquisitionFunction,
    Box,
    DirectedSpread,
    Discrepancy,
    InformationGain,
    RandomScore,
    SafeSet,
    Spread,
    WeightedSum,
)
from torch_activegp.acquisition.base import norm, root_mean_square
from torch_activegp.errors import ConfigurationError
from torch_activegp.models import DynamicsGP, PosteriorModule

BATCHES = [(), (1,), (5,), (2, 1, 3), (0,)]
SMOOTH: dict[str, Callable[[], AcquisitionFunction]] = {
    "discrepancy": Discrepancy,
    "discrepancy in units": lambda: Discrepancy([2.0, 0.5, 1.0]),
    "spread": Spread,
    "spread in units": lambda: Spread(0.1),
    "information gain": InformationGain,
    "directed spread": DirectedSpread,
}
FIXED = {**SMOOTH, "safe set": lambda: SafeSet(Box([0.1] * 3, [0.9] * 3))}
ALL = {**FIXED, "random": lambda: RandomScore(torch.Generator().manual_seed(1))}


def inputs(
    function: AcquisitionFunction, batch: tuple[int, ...], dtype: torch.dtype, generator: torch.Generator
) -> TensorDict:
    """Positive values, as standard deviations are; ``d`` = 3."""
    names = function.in_keys
    return TensorDict({key: 0.1 + torch.rand(*batch, 3, generator=generator, dtype=dtype) for key in names}, batch)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_one_value_a_point_in_the_dtype_of_the_inputs(
    name: str, batch: tuple[int, ...], dtype: torch.dtype, generator: torch.Generator
) -> None:
    function = ALL[name]()
    points = inputs(function, batch, dtype, generator)
    before = points.clone()
    value = function(points)[function.out_keys[0]]
    assert value.shape == (*batch, 1)
    assert value.dtype == dtype
    assert not value.isnan().any()
    assert set(points.keys()) == {*before.keys(), function.out_keys[0]}
    assert all(torch.equal(points[key], before[key]) for key in before.keys())


@pytest.mark.parametrize("name", FIXED)
def test_points_do_not_know_of_each_other(name: str, generator: torch.Generator) -> None:
    function = FIXED[name]()
    points = inputs(function, (4, 3), torch.float64, generator)
    together = function(points.clone())[function.out_keys[0]]
    one_by_one = torch.stack([function(point)[function.out_keys[0]] for point in points.reshape(-1).unbind(0)])
    torch.testing.assert_close(together.reshape(-1, 1), one_by_one, rtol=1e-14, atol=0)
    mapped = torch.vmap(torch.vmap(function.evaluate))(*(points[key] for key in function.in_keys))
    torch.testing.assert_close(together, mapped, rtol=1e-14, atol=0)


@pytest.mark.parametrize("name", ALL)
def test_keys_can_be_renamed_and_nested(name: str, generator: torch.Generator) -> None:
    plain, function = ALL[name](), ALL[name]()
    points = inputs(plain, (4,), torch.float64, generator)
    renamed = {key: ("model", f"my_{key}") for key in plain.in_keys}
    kwargs = {"in_keys": list(renamed.values()), "out_keys": [("score", "mine")]}
    unit = [function.unit] if isinstance(function, Discrepancy | Spread) else []
    special = {RandomScore: [torch.Generator().manual_seed(1)], SafeSet: [Box([0.1] * 3, [0.9] * 3)]}
    function = type(function)(*special.get(type(function), unit), **kwargs)
    other = TensorDict({}, [4])
    for key, new in renamed.items():
        other.set(new, points[key])
    expected = plain(points)[plain.out_keys[0]]
    assert torch.equal(function(other)["score", "mine"], expected)
    assert plain.out_keys[0] not in other.keys()


@pytest.mark.parametrize("name", SMOOTH)
def test_gradients_agree_with_finite_differences(name: str, generator: torch.Generator) -> None:
    function = SMOOTH[name]()
    points = inputs(function, (3,), torch.float64, generator)
    tensors = [points[key].requires_grad_() for key in function.in_keys]
    assert torch.autograd.gradcheck(function.evaluate, tensors)


@pytest.mark.parametrize("name", ALL)
def test_saving_and_pickling_keep_the_values(name: str, generator: torch.Generator) -> None:
    function = ALL[name]()
    copy = pickle.loads(pickle.dumps(function))
    fresh = ALL[name]()
    fresh.load_state_dict(function.state_dict())
    points = inputs(function, (4,), torch.float64, generator)
    out = function.out_keys[0]
    expected = function(points.clone())[out]
    assert torch.equal(copy(points.clone())[out], expected)
    assert torch.equal(fresh(points.clone())[out], expected)


def test_the_state_dict_holds_the_unit() -> None:
    function = Discrepancy([1.0, 1.0])
    function.load_state_dict(Discrepancy([2.0, 4.0]).state_dict())
    assert function.evaluate(torch.tensor([6.0, 0.0]), torch.zeros(2)).item() == 3.0


@pytest.mark.parametrize("name", ALL)
def test_a_wrong_number_of_keys_is_refused(name: str) -> None:
    function = ALL[name]()
    arguments = [function.generator] if isinstance(function, RandomScore) else []
    arguments = [function.contains] if isinstance(function, SafeSet) else arguments
    wanted = len(function.in_keys)
    for wrong in ({"in_keys": ["a"] * (wanted + 1)}, {"out_keys": ["a", "b"]}, {"out_keys": []}):
        with pytest.raises(ConfigurationError, match=rf"{type(function).__name__}: wanted {wanted} in_keys .* found"):
            type(function)(*arguments, **wrong)


@pytest.mark.parametrize("unit", [0.0, -1.0, [1.0, 0.0], float("nan"), float("inf"), [[1.0, 1.0]]])
@pytest.mark.parametrize("kind", [Discrepancy, Spread])
def test_a_unit_is_positive_and_finite(kind: type[Discrepancy | Spread], unit: float | list[float]) -> None:
    with pytest.raises(ConfigurationError, match=f"{kind.__name__}: wanted one positive unit, .*, found"):
        kind(unit)


def test_the_unit_is_a_copy() -> None:
    unit = torch.ones(2, dtype=torch.float64)
    function = Spread(unit)
    unit.zero_()
    assert function.evaluate(torch.ones(2)).item() == 1.0


def test_a_subclass_needs_only_keys_and_a_formula() -> None:
    class Largest(AcquisitionFunction):
        default_in_keys = (keys.SCALE,)
        default_out_keys = ("largest",)

        def evaluate(self, scale: torch.Tensor) -> torch.Tensor:
            return scale.amax(-1, keepdim=True)

    points = Largest()(TensorDict({"scale": torch.tensor([[1.0, 3.0], [2.0, 0.0]])}, [2]))
    assert points["largest"].flatten().tolist() == [3.0, 2.0]
    with pytest.raises(TypeError, match="abstract"):
        AcquisitionFunction()


def test_norms() -> None:
    values = torch.tensor([[3.0, 4.0], [0.0, 0.0]])
    assert norm(values).flatten().tolist() == [5.0, 0.0]
    torch.testing.assert_close(root_mean_square(values), torch.tensor([[12.5**0.5], [0.0]]))


@pytest.mark.parametrize("batch", [(), (6,), (2, 3)])
def test_a_score_composes_with_the_posterior(
    batch: tuple[int, ...],
    gp_with: Callable[..., DynamicsGP],
    points_of: Callable[..., TensorDict],
    generator: torch.Generator,
) -> None:
    gp = gp_with(8, generator)
    score = WeightedSum([Discrepancy(), Spread(), SafeSet(Box([-4.0, -9.0], [4.0, 9.0]))], [1.0, 0.5, 1.0])
    module = TensorDictSequential(PosteriorModule(gp, out_keys=score.in_keys), score)
    assert module.in_keys == ["state", "action"]
    points = points_of(6, generator)
    flat = module(points.clone())["score"]
    shaped = points[0].clone() if batch == () else points.clone().reshape(batch)
    value = module(shaped)["score"]
    assert value.shape == (*batch, 1)
    torch.testing.assert_close(value.reshape(-1, 1), flat[: value.numel()], rtol=1e-12, atol=1e-14)
