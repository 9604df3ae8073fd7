"""Sums of acquisition functions."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from tensordict.utils import NestedKey
from torch import nn

from torch_activegp import keys
from torch_activegp.acquisition.base import AcquisitionFunction
from torch_activegp.acquisition.discrepancy import Discrepancy
from torch_activegp.acquisition.spread import Spread
from torch_activegp.errors import ConfigurationError


class WeightedSum(TensorDictModuleBase):
    """sum_i weights[i] * terms[i], with -inf wherever a term of positive weight is -inf.

    Args:
        terms: acquisition functions; each also leaves its own value in the TensorDict.
        weights: one non-negative weight a term, default ones. A term of weight 0 is left out (0 * -inf is NaN).
        out_keys: the sum, ``(..., 1)``.

    Raises:
        ConfigurationError: no terms, as many weights as terms are not given, a weight is negative, or two terms write
            the same key.

    Example:
        >>> WeightedSum([Discrepancy(), Spread()], weights=[1.0, 0.1]).in_keys
        ['loc', 'prior_loc', 'scale']
    """

    def __init__(
        self,
        terms: Sequence[AcquisitionFunction],
        weights: Sequence[float] | None = None,
        out_keys: Sequence[NestedKey] = (keys.SCORE,),
    ) -> None:
        super().__init__()
        weights = [1.0] * len(terms) if weights is None else [float(weight) for weight in weights]
        if not terms or len(weights) != len(terms) or not all(weight >= 0 for weight in weights):
            raise ConfigurationError(
                f"WeightedSum: wanted at least one term and one weight >= 0 each, found {len(terms)} terms and "
                f"weights {weights}. Where less should be more, turn the sign inside the term."
            )
        written = [term.out_keys[0] for term in terms]
        if len(set(written)) != len(written):
            raise ConfigurationError(f"WeightedSum: two terms write the same key of {written}; give them out_keys.")
        self.terms = nn.ModuleList(terms)
        self.weights = weights
        self.in_keys = list(dict.fromkeys(key for term in terms for key in term.in_keys))
        self.out_keys = [*written, *out_keys]

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write every term and the sum."""
        total = torch.zeros((), device=tensordict.device)
        for term, weight in zip(self.terms, self.weights, strict=True):
            value = term(tensordict).get(term.out_keys[0])
            if weight:
                total = total + weight * value
        return tensordict.set(self.out_keys[-1], total)


def prior_discrepancy(beta: float = 1.0, unit: float | Sequence[float] = 1.0) -> WeightedSum:
    """The paper's acquisition function: A(u; x) = |mu - m_tau| + beta^(1/2) sigma.

    Add side information with ``WeightedSum([Discrepancy(), Spread(), SafeSet(...)], [1, beta**0.5, 1])``.

    Args:
        beta: weight of the uncertainty, not negative.
        unit: scale of each state.

    Raises:
        ConfigurationError: ``beta`` is negative.

    Reference: Miller et al. 2024 (arXiv 2403.17233), acquisition function.
    """
    if not beta >= 0:
        raise ConfigurationError(f"Wanted beta >= 0, found {beta}.")
    return WeightedSum([Discrepancy(unit), Spread(unit)], [1.0, beta**0.5])
