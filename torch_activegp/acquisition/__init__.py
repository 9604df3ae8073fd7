"""Acquisition functions: what an experiment is worth, as TensorDict modules."""

from torch_activegp.acquisition.base import AcquisitionFunction, InUnits
from torch_activegp.acquisition.directed_spread import DirectedSpread
from torch_activegp.acquisition.discrepancy import Discrepancy
from torch_activegp.acquisition.random_score import RandomScore
from torch_activegp.acquisition.safe_set import Box, SafeSet
from torch_activegp.acquisition.spread import InformationGain, Spread
from torch_activegp.acquisition.weighted_sum import WeightedSum, prior_discrepancy

__all__ = [
    "AcquisitionFunction",
    "Box",
    "DirectedSpread",
    "Discrepancy",
    "InUnits",
    "InformationGain",
    "RandomScore",
    "SafeSet",
    "Spread",
    "WeightedSum",
    "prior_discrepancy",
]
