"""Gaussian-process models of one-step dynamics."""

from torch_activegp.models.cached_posterior import CachedPosterior
from torch_activegp.models.dynamics_gp import DynamicsGP
from torch_activegp.models.fitting import FitResult, fit_hyperparameters, scaled_rbf
from torch_activegp.models.guard import GuardReport, HeldOutGuard
from torch_activegp.models.learned_simulator import LearnedSimulator
from torch_activegp.models.noise import (
    Count,
    FixedNoise,
    HeldNoise,
    InverseSquareNoise,
    LearnedNoise,
    NoiseSchedule,
    TheoremNoise,
)
from torch_activegp.models.output_scale import fit_output_scale
from torch_activegp.models.posterior_module import PosteriorModule

__all__ = [
    "CachedPosterior",
    "Count",
    "DynamicsGP",
    "FitResult",
    "FixedNoise",
    "GuardReport",
    "HeldNoise",
    "HeldOutGuard",
    "InverseSquareNoise",
    "LearnedNoise",
    "LearnedSimulator",
    "NoiseSchedule",
    "PosteriorModule",
    "TheoremNoise",
    "fit_hyperparameters",
    "fit_output_scale",
    "scaled_rbf",
]
