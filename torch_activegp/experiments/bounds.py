"""Bounds in place of a simulator's own, by the names of its states and actions."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import ActionSpace, Simulator, StateSpace


def set_bounds(simulator: Simulator, bounds: Mapping[str, tuple[float, float]]) -> None:
    """Replace bounds of a simulator's states and actions in place.

    Args:
        simulator: what to change.
        bounds: ``{name: (low, high)}``; a name's start before a dot stands for all such dimensions, for example
            ``{"qvel": (-20.0, 20.0)}``.

    Raises:
        ConfigurationError: no state or action has that name, or low is above high.

    Example:
        >>> from torch_activegp.simulators import Pendulum
        >>> pendulum = Pendulum()
        >>> set_bounds(pendulum, {"theta_dot": (-4.0, 4.0)})
        >>> pendulum.state_space.high.tolist()[1]
        4.0
    """
    states, actions = simulator.state_space, simulator.action_space
    names = (*states.names, *actions.names)
    lows, highs = (torch.cat(ends).tolist() for ends in ((states.low, actions.low), (states.high, actions.high)))
    limits = list(zip(lows, highs, strict=True))
    for key, limit in bounds.items():
        matches = [index for index, name in enumerate(names) if name == key or name.startswith(f"{key}.")]
        if not matches:
            raise ConfigurationError(f"bounds: found no state or action `{key}`; there are {', '.join(names)}.")
        for index in matches:
            limits[index] = limit
    low, high = [limit[0] for limit in limits], [limit[1] for limit in limits]
    d = states.dim
    simulator.state_space = StateSpace(states.names, low[:d], high[:d], states.angles, states.quaternions)
    simulator.action_space = ActionSpace(actions.names, low[d:], high[d:])
