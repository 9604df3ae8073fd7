"""Planners that choose actions by imagining their outcome in a model."""

from torch_activegp.planners.colored_noise import ColoredNoise
from torch_activegp.planners.icem import ICEMPlanner
from torch_activegp.planners.sampling import Sampling
from torch_activegp.planners.warm_start import WarmStart

__all__ = ["ColoredNoise", "ICEMPlanner", "Sampling", "WarmStart"]
