"""The parts of a run that change while it runs, and their state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from functools import partial
from typing import Any

import torch
from torch import nn
from torchrl.envs import TransformedEnv


class StatefulParts:
    """Everything with a state among some objects, by name: one state to save, one to restore.

    A part is what has ``state_dict`` and ``load_state_dict``, or a :class:`torch.Generator`. Of a
    :func:`functools.partial` the arguments are looked at. A module may use others that its ``state_dict`` leaves out: a
    planner does not own the model that it plans in, and a ``TransformedEnv`` forgets its base. These are parts, too, so
    the chance inside an acquisition function is covered without being named.

    Args:
        items: objects by name; those without a state are left out.

    Example:
        >>> generator = torch.Generator().manual_seed(0)
        >>> parts = StatefulParts({"fit": partial(print, generator=generator), "layer": nn.Linear(1, 1), "other": 3})
        >>> list(parts.items)
        ['fit.generator', 'layer']
    """

    def __init__(self, items: Mapping[str, Any]) -> None:
        self.items: dict[str, Any] = {}
        for name, item in items.items():
            self._add(name, item)

    def _add(self, name: str, item: Any) -> None:
        if any(item is known for known in self.items.values()):
            return
        if isinstance(item, partial):
            for key, value in (*enumerate(item.args), *item.keywords.items()):
                self._add(f"{name}.{key}", value)
        elif isinstance(item, torch.Generator) or hasattr(item, "state_dict"):
            self.items[name] = item
        if isinstance(item, nn.Module):
            for path, module in _left_out(item):
                self._add(f"{name}.{path}", module)

    def state(self) -> dict[str, Any]:
        """A copy of all states."""
        return deepcopy({name: _get(item) for name, item in self.items.items()})

    def restore(self, state: Mapping[str, Any]) -> None:
        """Put all parts back into an earlier :meth:`state`.

        Raises:
            ValueError: the state belongs to other parts.
        """
        if state.keys() != self.items.keys():
            raise ValueError(f"wanted the states of {sorted(self.items)}, found those of {sorted(state)}")
        for name, item in self.items.items():
            if isinstance(item, torch.Generator):
                item.set_state(state[name])
            else:
                item.load_state_dict(state[name])


def _get(item: Any) -> Any:
    return item.get_state() if isinstance(item, torch.Generator) else dict(item.state_dict())


def _left_out(module: nn.Module) -> Iterator[tuple[str, nn.Module]]:
    """Modules that a module or its submodules use and whose state its ``state_dict`` leaves out."""
    for path, inner in module.named_modules():
        used = {key: value for key, value in vars(inner).items() if isinstance(value, nn.Module)}
        if isinstance(inner, TransformedEnv):
            used["base_env"] = inner.base_env
        for key, value in used.items():
            yield f"{path}.{key}".lstrip("."), value
