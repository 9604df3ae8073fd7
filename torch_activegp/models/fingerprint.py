"""Noticing that modules changed, whoever changed them."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn


class Fingerprint:
    """Remembers the parameters, buffers and parts of modules, and says whether they changed since the last look.

    Example:
        >>> fingerprint, layer = Fingerprint(), nn.Linear(2, 1)
        >>> fingerprint.changed([layer]), fingerprint.changed([layer])
        (True, False)
    """

    def __init__(self) -> None:
        self._parts: list[nn.Module] = []
        self._values: list[Tensor] = []

    def changed(self, modules: Sequence[nn.Module], values: Sequence[Tensor] = ()) -> bool:
        """Whether anything differs from the last look; the first look counts as a change.

        Args:
            modules: their parts are compared by identity, their parameters and buffers by value.
            values: further tensors to compare by value.
        """
        parts = [part for module in modules for part in module.modules()]
        held = (value for part in parts for value in (*part._parameters.values(), *part._buffers.values()))
        present = [*(value for value in held if value is not None), *values]
        same = len(present) == len(self._values) and parts == self._parts
        if same and all(map(torch.equal, present, self._values)):
            return False
        self._parts, self._values = parts, [value.detach().clone() for value in present]
        return True
