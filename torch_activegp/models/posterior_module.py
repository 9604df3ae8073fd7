"""The posterior of a DynamicsGP as a TensorDict module."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from tensordict.utils import NestedKey
from torch import Tensor

from torch_activegp import keys
from torch_activegp.errors import ConfigurationError
from torch_activegp.models.cached_posterior import CachedPosterior, Features
from torch_activegp.models.dynamics_gp import DynamicsGP


def posterior_quantities(posterior: CachedPosterior, features: Features, names: Sequence[str]) -> dict[str, Tensor]:
    """Compute the named posterior quantities at points whose features are known.

    Args:
        posterior: the posterior.
        features: its features at ``n'`` points.
        names: some of :data:`~torch_activegp.keys.POSTERIOR_KEYS`.

    Returns:
        One tensor ``(n', d)`` for each name.
    """
    return {name: _QUANTITIES[name](posterior, features) for name in names}


_QUANTITIES: dict[str, Callable[[CachedPosterior, Features], Tensor]] = {
    keys.LOC: CachedPosterior.loc,
    keys.SCALE: CachedPosterior.scale,
    keys.PRIOR_LOC: CachedPosterior.prior_loc,
    keys.SIMULATOR_LOC: lambda posterior, features: features.simulator_loc,
    keys.NOISE_SCALE: lambda posterior, features: posterior.noise_scale.expand_as(features.outer),
    keys.SIGNAL_SCALE: lambda posterior, features: posterior.output_scale.expand_as(features.outer),
}


class PosteriorModule(TensorDictModuleBase):
    """Write what the GP says about the next state into a TensorDict.

    Args:
        gp: the model.
        in_keys: state ``(..., d)`` and action ``(..., m)``.
        out_keys: which quantities to compute, of :data:`~torch_activegp.keys.POSTERIOR_KEYS`; each ``(..., d)``.

    Raises:
        ConfigurationError: an unknown quantity.

    Example:
        >>> import gpytorch
        >>> from tensordict import TensorDict
        >>> from torch_activegp.means import SimulatorMean
        >>> from torch_activegp.simulators import Pendulum
        >>> module = PosteriorModule(DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel()))
        >>> module(TensorDict({"state": torch.zeros(4, 2), "action": torch.zeros(4, 1)}, [4]))["scale"].shape
        torch.Size([4, 2])
    """

    def __init__(
        self,
        gp: DynamicsGP,
        in_keys: Sequence[NestedKey] = (keys.STATE, keys.ACTION),
        out_keys: Sequence[str] = (keys.LOC, keys.SCALE),
    ) -> None:
        super().__init__()
        unknown = [key for key in out_keys if key not in keys.POSTERIOR_KEYS]
        if unknown:
            raise ConfigurationError(f"Wanted out_keys of {keys.POSTERIOR_KEYS}, found {unknown}.")
        self.gp = gp
        self.in_keys = list(in_keys)
        self.out_keys = list(out_keys)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Fill :attr:`out_keys`; gradients flow to state and action."""
        z = torch.cat([tensordict.get(key) for key in self.in_keys], dim=-1).to(self.gp.output_scale)
        posterior = self.gp.posterior
        features = posterior.features(z.reshape(-1, z.shape[-1]))
        for name, value in posterior_quantities(posterior, features, self.out_keys).items():
            tensordict.set(name, value.reshape(*z.shape[:-1], value.shape[-1]))
        return tensordict
