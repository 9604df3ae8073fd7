"""The state that ``reset(tensordict, set_state=True)`` is to start from."""

from __future__ import annotations

import torch
from tensordict import TensorDictBase
from torch import Tensor

from torch_activegp import keys
from torch_activegp.errors import ConfigurationError, ShapeError


def given_state(tensordict: TensorDictBase | None, like: Tensor, dim: int) -> Tensor:
    """Read the start state, rather than start somewhere else in silence.

    Args:
        tensordict: what ``reset`` was given, batch ``*B``.
        like: a tensor of the wanted dtype and device.
        dim: the number of states d.

    Returns:
        A copy of the state, ``(*B, d)``.

    Raises:
        ConfigurationError: there is no state, or it is not finite.
        ShapeError: it has another shape.
    """
    state = None if tensordict is None else tensordict.get(keys.STATE, None)
    if tensordict is None or state is None:
        raise ConfigurationError(
            f"reset(tensordict, set_state=True) wants a tensordict with {keys.STATE!r}, found none."
        )
    if state.shape != (*tensordict.shape, dim):
        raise ShapeError(
            f"reset: wanted a state of shape {(*tensordict.shape, dim)} in a tensordict of shape "
            f"{tuple(tensordict.shape)}, found {tuple(state.shape)}."
        )
    if not bool(torch.isfinite(state).all()):
        raise ConfigurationError(f"reset: wanted a finite state, found {state.tolist()}.")
    return state.to(like, copy=True)
