"""Sums of scores: the formula, weight 0, -inf, and what is refused."""

from __future__ import annotations

import pickle

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from torch_activegp.acquisition import AcquisitionFunction, Discrepancy, SafeSet, Spread, WeightedSum, prior_discrepancy
from torch_activegp.errors import ConfigurationError

INF = float("inf")


class Constant(AcquisitionFunction):
    """One value at all points."""

    default_in_keys = ("loc",)
    default_out_keys = ("constant",)

    def __init__(self, value: float, out_key: str = "constant") -> None:
        super().__init__(out_keys=[out_key])
        self.value = value

    def evaluate(self, loc: Tensor) -> Tensor:
        return torch.full_like(loc[..., :1], self.value)


def points(*batch: int, dtype: torch.dtype = torch.float64) -> TensorDict:
    generator = torch.Generator().manual_seed(3)
    names = ("loc", "prior_loc", "scale")
    return TensorDict({key: torch.rand(*batch, 2, generator=generator, dtype=dtype) for key in names}, batch)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
@pytest.mark.parametrize("device", [None, "cpu"])
def test_it_is_the_weighted_sum(device: str | None, batch: tuple[int, ...], dtype: torch.dtype) -> None:
    td = points(*batch, dtype=dtype)
    td = td if device is None else td.to(device)
    expected = 0.5 * (td["loc"] - td["prior_loc"]).norm(dim=-1) + 2 * (td["scale"].square().mean(-1)).sqrt()
    out = WeightedSum([Discrepancy(), Spread()], [0.5, 2.0])(td)
    assert out["score"].dtype == dtype
    assert out["score"].shape == (*batch, 1)
    torch.testing.assert_close(out["score"].squeeze(-1), expected)
    assert {"discrepancy", "spread"} <= set(out.keys())


def test_the_weights_are_ones_by_default() -> None:
    assert WeightedSum([Constant(1.0, "a"), Constant(2.0, "b")])(points(3))["score"].tolist() == [[3.0]] * 3


def test_a_forbidden_point_stays_forbidden_unless_its_weight_is_zero() -> None:
    terms = [Spread(), Constant(-INF)]
    assert WeightedSum(terms, [1.0, 1e-300])(points(3))["score"].tolist() == [[-INF]] * 3
    out = WeightedSum(terms, [1.0, 0.0])(points(3))
    assert torch.equal(out["score"], out["spread"])
    assert out["constant"].tolist() == [[-INF]] * 3


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_all_weights_zero_gives_zeros(dtype: torch.dtype) -> None:
    out = WeightedSum([Spread(), Constant(-INF)], [0.0, 0.0])(points(2, 3, dtype=dtype))
    assert torch.equal(out["score"], torch.zeros(2, 3, 1, dtype=dtype))


def test_nan_is_not_hidden() -> None:
    assert WeightedSum([Constant(torch.nan), Spread()])(points(2))["score"].isnan().all()


def test_keys_are_gathered_once_and_the_sum_comes_last() -> None:
    score = WeightedSum([Discrepancy(), Spread(), SafeSet(lambda x: x[..., 0] < 1)], out_keys=[("a", "total")])
    assert score.in_keys == ["loc", "prior_loc", "scale"]
    assert score.out_keys == ["discrepancy", "spread", "safe", ("a", "total")]
    assert score(points(3))["a", "total"].shape == (3, 1)


def test_sums_can_be_summed() -> None:
    inner = WeightedSum([Discrepancy(), Spread()], [1.0, 2.0], out_keys=["inner"])
    out = WeightedSum([inner, Constant(5.0)], [3.0, 1.0])(points(4))
    torch.testing.assert_close(out["score"], 3 * (out["discrepancy"] + 2 * out["spread"]) + 5)


def test_gradients_flow_through_every_term() -> None:
    td = points(3)
    td["loc"].requires_grad_()
    td["scale"].requires_grad_()
    WeightedSum([Discrepancy(), Spread()], [1.0, 2.0])(td)["score"].sum().backward()
    assert td["loc"].grad.norm() > 0
    torch.testing.assert_close(td["scale"].grad, 2 * td["scale"] / 2 / Spread().evaluate(td["scale"]))


def test_saving_and_pickling_keep_the_units_of_the_terms() -> None:
    score, other = prior_discrepancy(beta=4.0, unit=[2.0, 3.0]), prior_discrepancy(beta=4.0, unit=[1.0, 1.0])
    other.load_state_dict(score.state_dict())
    expected = score(points(3))["score"]
    assert torch.equal(other(points(3))["score"], expected)
    assert torch.equal(pickle.loads(pickle.dumps(score))(points(3))["score"], expected)


@pytest.mark.parametrize("beta", [0.0, 0.25, 4.0])
def test_the_papers_score(beta: float) -> None:
    out = prior_discrepancy(beta, unit=[0.5, 2.0])(points(4))
    unit = torch.tensor([0.5, 2.0])
    expected = ((out["loc"] - out["prior_loc"]) / unit).norm(dim=-1)
    expected = expected + beta**0.5 * (out["scale"] / unit).square().mean(-1).sqrt()
    torch.testing.assert_close(out["score"].squeeze(-1), expected)


@pytest.mark.parametrize("beta", [-1.0, float("nan")])
def test_beta_is_not_negative(beta: float) -> None:
    with pytest.raises(ConfigurationError, match="Wanted beta >= 0, found"):
        prior_discrepancy(beta)


@pytest.mark.parametrize(
    ("terms", "weights"),
    [([], None), ([Spread()], [1.0, 2.0]), ([Spread()], [-1.0]), ([Spread()], [torch.nan]), ([Spread()], [INF])],
)
def test_wrong_weights_are_refused(terms: list[AcquisitionFunction], weights: list[float] | None) -> None:
    with pytest.raises(ConfigurationError, match="wanted at least one term and one finite weight >= 0 each, found"):
        WeightedSum(terms, weights)


@pytest.mark.parametrize(
    ("terms", "out_keys"),
    [([Spread(), Spread()], ["score"]), ([Spread()], ["spread"]), ([Spread()], []), ([Spread()], ["a", "b"])],
)
def test_a_key_written_twice_is_refused(terms: list[AcquisitionFunction], out_keys: list[str]) -> None:
    with pytest.raises(ConfigurationError, match="wanted one out_key and distinct ones in the terms, found"):
        WeightedSum(terms, out_keys=out_keys)


def test_the_papers_discrepancy_can_refer_to_the_simulator() -> None:
    loc, zero = torch.tensor([[3.0, 4.0]]), torch.zeros(1, 2)
    td = TensorDict({"loc": loc, "prior_loc": loc, "simulator_loc": zero, "scale": zero}, [1])
    assert prior_discrepancy()(td)["score"].item() == 0.0
    assert prior_discrepancy(reference="simulator_loc")(td)["score"].item() == 5.0
