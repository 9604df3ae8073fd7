"""Sums of acquisition functions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import cast

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from tensordict.utils import NestedKey
from torch import Tensor, nn

from torch_activegp import keys
from torch_activegp.acquisition.base import AcquisitionFunction
from torch_activegp.acquisition.discrepancy import Discrepancy
from torch_activegp.acquisition.spread import Spread
from torch_activegp.errors import ConfigurationError


class WeightedSum(TensorDictModuleBase):
    """sum_i weights[i] * terms[i], with -inf wherever a term of positive weight is -inf.

    Args:
        terms: acquisition functions, or sums of them; each also leaves its own value in the TensorDict.
        weights: one finite, non-negative weight a term, default ones. A term of weight 0 is evaluated and not added
            (0 * -inf is NaN).
        out_keys: the sum, ``(..., 1)``.

    Raises:
        ConfigurationError: no terms, another number of weights than of terms, a weight that is negative or infinite,
            or a key that is written twice.

    Example:
        >>> WeightedSum([Discrepancy(), Spread()], weights=[1.0, 0.1]).in_keys
        ['loc', 'prior_loc', 'scale']
    """

    def __init__(
        self,
        terms: Sequence[AcquisitionFunction | WeightedSum],
        weights: Sequence[float] | None = None,
        out_keys: Sequence[NestedKey] = (keys.SCORE,),
    ) -> None:
        super().__init__()
        weights = [1.0] * len(terms) if weights is None else [float(weight) for weight in weights]
        if not terms or len(weights) != len(terms) or not all(0 <= weight < math.inf for weight in weights):
            raise ConfigurationError(
                f"WeightedSum: wanted at least one term and one finite weight >= 0 each, found {len(terms)} terms and "
                f"weights {weights}. Where less should be more, turn the sign inside the term."
            )
        self.terms = nn.ModuleList(terms)
        self.weights = weights
        self.in_keys: list[NestedKey] = list(dict.fromkeys(key for term in terms for key in term.in_keys))
        self.out_keys: list[NestedKey] = [*(key for term in terms for key in term.out_keys), *out_keys]
        if len(out_keys) != 1 or len(set(self.out_keys)) != len(self.out_keys):
            raise ConfigurationError(
                f"WeightedSum: wanted one out_key and distinct ones in the terms, found {self.out_keys}, the last "
                f"{len(out_keys)} of the sum. Give the terms out_keys of their own."
            )

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write every term and the sum."""
        terms = cast(Iterable[TensorDictModuleBase], self.terms)
        values = [term(tensordict).get(term.out_keys[-1]) for term in terms]
        total = torch.zeros_like(values[0])
        for value, weight in zip(values, self.weights, strict=True):
            if weight:
                total = torch.add(total, value, alpha=weight)
        return tensordict.set(self.out_keys[-1], total)


def prior_discrepancy(
    beta: float = 1.0, unit: float | Sequence[float] | Tensor = 1.0, reference: NestedKey = keys.PRIOR_LOC
) -> WeightedSum:
    """The paper's acquisition function: A(u; x) = |mu - m_tau| + beta^(1/2) sigma.

    Add side information with ``WeightedSum([Discrepancy(), Spread(), SafeSet(...)], [1, beta**0.5, 1])``.

    Args:
        beta: weight of the uncertainty, not negative.
        unit: scale of each state.
        reference: what the discrepancy is measured from; ``PRIOR_LOC`` is m_tau, ``SIMULATOR_LOC`` is p0.

    Raises:
        ConfigurationError: ``beta`` is negative.

    Reference: Miller et al. 2024 (arXiv 2403.17233), acquisition function.
    """
    if not beta >= 0:
        raise ConfigurationError(f"Wanted beta >= 0, found {beta}.")
    return WeightedSum([Discrepancy(unit, in_keys=[keys.LOC, reference]), Spread(unit)], [1.0, beta**0.5])
