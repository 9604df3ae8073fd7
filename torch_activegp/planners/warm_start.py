"""What a planner remembers from one environment step to the next."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from torch_activegp.errors import CheckpointError


class WarmStart(nn.Module):
    """The mean and the best candidates of the last plan, moved on by one step for the next plan.

    Both follow ``.to(device)`` and are part of the ``state_dict``; an empty memory is a valid state.

    Args:
        horizon: number of actions of a plan.
        action_dim: number of actions of one step, m.

    Attributes:
        mean: ``(*B, horizon, m)``, or None before the first plan.
        elites: ``(*B, num_kept, horizon, m)``, best first, or None before the first plan.

    Reference:
        Pinneri et al. 2020, section 3.2 and Algorithm 1 ("shift elites over time", "shift initialisation"),
        arXiv 2008.06389.

    Example:
        >>> memory = WarmStart(horizon=3, action_dim=1)
        >>> memory.store(torch.tensor([[1.0], [2.0], [3.0]]), torch.zeros(0, 3, 1))
        >>> memory.shifted_mean().flatten().tolist()
        [2.0, 3.0, 3.0]
    """

    mean: Tensor | None
    elites: Tensor | None

    def __init__(self, horizon: int, action_dim: int) -> None:
        super().__init__()
        self.horizon = horizon
        self.action_dim = action_dim
        self.register_buffer("mean", None, persistent=False)
        self.register_buffer("elites", None, persistent=False)

    def fits(self, batch_shape: torch.Size) -> bool:
        """Tell whether a plan for this batch of starting states is remembered."""
        return self.mean is not None and self.mean.shape[:-2] == batch_shape

    def store(self, mean: Tensor, elites: Tensor) -> None:
        """Remember a plan.

        Args:
            mean: mean of the candidates, ``(*B, horizon, m)``.
            elites: best candidates, best first, ``(*B, num_kept, horizon, m)``.
        """
        self.mean = mean
        self.elites = elites

    def forget(self) -> None:
        """Empty the memory: the next plan starts from nothing."""
        self.mean = None
        self.elites = None

    def shifted_mean(self) -> Tensor:
        """Return the mean one step later, the last action repeated: ``(*B, horizon, m)``."""
        mean = self._filled(self.mean)
        return torch.cat([mean[..., 1:, :], mean[..., -1:, :]], dim=-2)

    def shifted_elites(self, fresh: Tensor) -> Tensor:
        """Return the elites one step later, their last actions taken from fresh candidates.

        Args:
            fresh: new candidates, ``(*B, num_kept, horizon, m)``.
        """
        return torch.cat([self._filled(self.elites)[..., 1:, :], fresh[..., -1:, :]], dim=-2)

    def get_extra_state(self) -> dict[str, Tensor | None]:
        """Return the memory for the ``state_dict``."""
        return {"mean": self.mean, "elites": self.elites}

    def set_extra_state(self, state: dict[str, Tensor | None]) -> None:
        """Restore the memory from ``get_extra_state``.

        Raises:
            CheckpointError: the memory belongs to plans of another horizon or number of actions.
        """
        wanted = (self.horizon, self.action_dim)
        for name in ("mean", "elites"):
            value = state[name]
            if value is not None and value.shape[-2:] != wanted:
                raise CheckpointError(
                    f"The saved {name} of the planner has (horizon, actions) = {tuple(value.shape[-2:])}, this planner "
                    f"has {wanted}. Build the planner with the settings of the checkpoint, or start afresh."
                )
        self.mean, self.elites = state["mean"], state["elites"]

    @staticmethod
    def _filled(value: Tensor | None) -> Tensor:
        if value is None:
            raise RuntimeError("The memory is empty: ask `fits` before a shift.")
        return value
