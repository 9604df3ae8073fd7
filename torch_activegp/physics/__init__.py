"""Physics that simulators leave out: one file for each family of effects."""

from torch_activegp.physics.catalogue import catalogue
from torch_activegp.physics.effect import Effect, Parameter, Place, Step

__all__ = ["Effect", "Parameter", "Place", "Step", "catalogue"]
