"""The training data of a GP with several outputs: stored once, seen by gpytorch as a batch, saved with the model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from torch_activegp.errors import DataError, ShapeError
from torch_activegp.means import EpisodicMean
from torch_activegp.models.fingerprint import Fingerprint

if TYPE_CHECKING:
    from torch_activegp.models.cached_posterior import CachedPosterior
    from torch_activegp.models.dynamics_gp import DynamicsGP


class TrainingData(nn.Module):
    """Mixin for an ExactGP of batch shape ``(d,)``: data as buffers ``inputs`` ``(n, D)`` and ``targets`` ``(n, d)``.

    gpytorch wants ``train_inputs`` of shape ``(d, n, D)`` and ``train_targets`` ``(d, n)``; these are views. The data
    and the terms of an :class:`~torch_activegp.means.EpisodicMean` go into the state dict, whatever their number.
    """

    inputs: Tensor
    targets: Tensor
    output_scale: Tensor
    _counts: Tensor
    _cache: CachedPosterior | None
    batch_shape: torch.Size

    @property
    def num_points(self) -> int:
        """The number of points n."""
        return self.inputs.shape[0]

    @property
    def train_inputs(self) -> tuple[Tensor] | None:
        """View of gpytorch of the inputs: one tensor ``(d, n, D)``, or None without data."""
        if "inputs" not in self._buffers or not self.num_points:
            return None
        return (self.inputs.expand(*self.batch_shape, *self.inputs.shape),)

    @train_inputs.setter
    def train_inputs(self, value: tuple[Tensor, ...] | None) -> None:
        inputs = torch.zeros(0, 0) if value is None else value[0]
        self.register_buffer("inputs", inputs[0] if inputs.dim() == 3 else inputs)

    @property
    def train_targets(self) -> Tensor | None:
        """View of gpytorch of the targets: ``(d, n)``, or None without data."""
        return self.targets.mT if "targets" in self._buffers and self.num_points else None

    @train_targets.setter
    def train_targets(self, value: Tensor | None) -> None:
        self.register_buffer("targets", torch.zeros(0, 0) if value is None else value.mT)

    def set_train_data(self, inputs: Any = None, targets: Tensor | None = None, strict: bool = True) -> None:
        """Set the data as gpytorch does: inputs ``(d, n, D)`` or ``(n, D)``, targets ``(d, n)``, already unwrapped."""
        super().set_train_data(inputs, targets, strict)  # type: ignore[misc]
        self._counts[1].clamp_(min=1)  # the posterior is no longer the one that the episode began with
        self.forget()

    def add_points(self, z: Tensor, targets: Tensor) -> None:
        """Add points ``(n', D)`` with targets ``(n', d)``."""
        if self.num_points:
            z, targets = torch.cat([self.inputs, z]), torch.cat([self.targets, targets])
        self.inputs, self.targets = z, targets
        self.prediction_strategy = None

    def forget(self) -> None:
        """Drop what was computed for the present data and hyper-parameters: our posterior and gpytorch's."""
        self._cache, self.prediction_strategy = None, None

    def _apply(self, fn: Any, recurse: bool = True) -> nn.Module:
        self.forget()
        self._mean_seen, self._seen = Fingerprint(), Fingerprint()
        return nn.Module._apply(self, fn, recurse)

    def _load_from_state_dict(self, state_dict: Mapping[str, Any], prefix: str, *args: Any) -> None:
        for name in ("inputs", "targets"):
            if prefix + name in state_dict:
                setattr(self, name, torch.empty_like(state_dict[prefix + name]).to(self.output_scale))
        mean = self.mean_module
        if isinstance(mean, EpisodicMean):
            stem = prefix + "mean_module.expansions."
            indices = sorted({int(key[len(stem) :].split(".")[0]) for key in state_dict if key.startswith(stem)})
            shapes = [(state_dict[f"{stem}{i}.centers"].shape, state_dict[f"{stem}{i}.weights"].shape) for i in indices]
            mean.allocate(self.covar_module, shapes)
        self.forget()
        super()._load_from_state_dict(state_dict, prefix, *args)


def check_transitions(gp: DynamicsGP, state: Tensor, action: Tensor, next_state: Tensor) -> tuple[Tensor, Tensor]:
    """Check transitions and bring them to the GP's dtype and device.

    Returns:
        The inputs z ``(n', d + m)`` and next states ``(n', d)``.

    Raises:
        ShapeError: shapes do not fit.
        DataError: a value is not finite.
    """
    d = gp.num_outputs
    if not (state.dim() == action.dim() == next_state.dim() == 2 and state.shape == next_state.shape):
        raise ShapeError(
            f"Wanted state (n, {d}), action (n, m) and next_state (n, {d}), found {tuple(state.shape)}, "
            f"{tuple(action.shape)} and {tuple(next_state.shape)}."
        )
    if state.shape[-1] != d or state.shape[0] != action.shape[0]:
        raise ShapeError(
            f"Wanted {d} states and as many actions as states, found {tuple(state.shape)} and {tuple(action.shape)}."
        )
    z = torch.cat([state, action], dim=-1).to(gp.output_scale)
    if gp.num_points and z.shape[-1] != gp.inputs.shape[-1]:
        raise ShapeError(f"Wanted {gp.inputs.shape[-1]} inputs as in the data so far, found {z.shape[-1]}.")
    next_state = next_state.to(gp.output_scale)
    bad = ~torch.isfinite(torch.cat([z, next_state], dim=-1)).all(-1)
    if bad.any():
        raise DataError(
            f"Wanted finite transitions, found NaN or infinity in row {int(bad.nonzero()[0])} of {z.shape[0]}. "
            "Drop such rows, or look at the simulator or recording that made them."
        )
    return z, next_state
