"""Physics that simulators leave out: one file for each family of effects."""

from torch_activegp.physics.catalogue import catalogue
from torch_activegp.physics.effect import Effect, Parameter, Step
from torch_activegp.physics.place import Place

__all__ = ["Effect", "Parameter", "Place", "Step", "catalogue"]
