"""The corrected simulator of a diagnosis, also where the nominal one only returns its next state."""

from __future__ import annotations

import torch
from torch import Tensor

from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.inputs.source import Source
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.correction import Form
from torch_activegp.diagnosis.simulation.simulator import EffectSimulator, as_numbers, corrected_simulator
from torch_activegp.errors import SimulationError
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

    def __init__(self, box: BlackBox, channels: Channels, candidate: Candidate) -> None:
        Simulator.__init__(self, box.simulator.state_space, box.simulator.action_space, box.simulator.dt)
        self.model, self.channels, self.candidate = box.model, channels, candidate
        self.substeps, self.integrator = 1, None
        self._engine: BlackBoxEngine = BlackBoxEngine(box, channels, 1)

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__

    def rollout(self, state: Tensor, actions: Tensor) -> Tensor:
        """Applies a sequence of actions; see `Simulator.rollout`.

        Raises:
            ShapeError: the shapes do not fit.
            SimulationError: an input requires a gradient, or the nominal simulator fails.
        """
        batch = self._check_rollout(state, actions)
        if torch.is_grad_enabled() and (state.requires_grad or actions.requires_grad):
            raise SimulationError(
                "AcceleratedSimulator: an input requires a gradient, and effects give none. Detach it."
            )
        size, count, order = batch.numel(), actions.shape[-2], self._engine.box.order
        if size == 0 or count == 0:
            return state.new_empty(*batch, count, self.state_dim)
        clipped = self.action_space.clamp(actions.expand(*batch, *actions.shape[-2:]))
        begin = as_numbers(state.expand(*batch, self.state_dim)).reshape(size, self.state_dim)[:, order]
        control = as_numbers(clipped).reshape(size, count, self.action_dim)
        after = self._engine.trajectories(self._segments(begin, control), begin, self.candidate)[:, 1:]
        states = torch.empty(size, count, self.state_dim, dtype=torch.float64)
        states[..., torch.from_numpy(order)] = torch.from_numpy(after)
        wrapped = self.state_space.wrap(states.reshape(*batch, count, -1).to(self.state_space.low.device))
        return wrapped.to(state)


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
