"""The numerics of a black box: its integrator and its time step cannot be chosen, but its controls may come later."""

from __future__ import annotations

from typing import Self

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.engine import substeps_for


class GivenNumerics(Numerics):
    """The forms of a black box: as it is, and with its controls half a time step late.

    Its integrator and its time step cannot be chosen. But semi-implicit Euler, the most common one, is exact to second
    order once its controls come half a step later, and where it is the simulator's, the recordings say so.
    """

    @classmethod
    def of(cls, machine: Machine, nthread: int = 0) -> Self:
        """Makes them for a machine whose model is a black box."""
        assert machine.box is not None
        substeps = substeps_for(machine.model, machine.fit)
        given, late = (BlackBoxEngine(machine.box, machine.channels, substeps, late=late) for late in (False, True))
        return cls(given, late, given, late)

    def _may_stick(self, fit: Fit) -> bool:
        """Always: nobody knows what holds the joints of a black box."""
        return True


def numerics_of(machine: Machine, nthread: int = 0) -> Numerics:
    """The forms of a machine's model, or of the black box that it stands for.

    Args:
        machine: model and runs.
        nthread: threads of the simulations; 0 for all cores.
    """
    return (Numerics if machine.box is None else GivenNumerics).of(machine, nthread)
