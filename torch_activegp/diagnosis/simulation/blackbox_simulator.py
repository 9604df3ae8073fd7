"""The corrected simulator of a diagnosis, also where the nominal one only returns its next state."""

from __future__ import annotations

from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.inputs.source import Source
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.correction import Form
from torch_activegp.diagnosis.simulation.simulator import EffectSimulator, corrected_simulator
from torch_activegp.simulators import Simulator


class AcceleratedSimulator(EffectSimulator):
    """A simulator with effects that accelerate its velocities, as the diagnosis simulated them; no gradients.

    State, action and time step are those of the nominal. What the state cannot hold (a delayed control) lives through
    one ``rollout`` and starts anew at each ``step``. Effects on sensors change recordings, not the motion, and do
    nothing here.

    Args:
        box: the nominal simulator.
        channels: the joints that effects with a memory follow.
        candidate: effects and their values.
    """

    _gives_none = "effects give none"

    def __init__(self, box: BlackBox, channels: Channels, candidate: Candidate) -> None:
        Simulator.__init__(self, box.simulator.state_space, box.simulator.action_space, box.simulator.dt)
        self.model, self.channels, self.candidate = box.model, channels, candidate
        self.substeps, self.integrator = 1, None
        self._order = box.order
        self._engine = BlackBoxEngine(box, channels, 1)

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__


def simulator_with(
    source: Source,
    channels: Channels,
    candidate: Candidate,
    xml: str | None,
    numerics: Form | None = None,
) -> Simulator | None:
    """The simulator with effects in it, of any nominal; arguments and result as in `corrected_simulator`.

    A black box without effects is the nominal simulator itself, with effects an `AcceleratedSimulator`.
    """
    if source.box is None:
        return corrected_simulator(source, channels, candidate, xml, numerics)
    return AcceleratedSimulator(source.box, channels, candidate) if candidate.effects else source.box.simulator
