"""The signal's scale in closed form, without any optimiser."""

from __future__ import annotations

import torch

from torch_activegp.models.dynamics_gp import DynamicsGP


@torch.no_grad()
def fit_output_scale(gp: DynamicsGP, smallest: float = 1e-6) -> None:
    """Set each output's scale to its maximum-likelihood value for the present kernel and relative noise.

    For output j with residuals r_j about the simulator, s_j^2 = r_j' (K + noise I)^-1 r_j / n. Predictions of the mean
    do not change (the relative noise is kept, if the likelihood has one for each output), only the scale of the
    uncertainty does. Where all length-scales are known, it is the whole fit.

    Args:
        gp: its ``output_scale`` is set in place; with fewer than two points it is left alone.
        smallest: lower limit of the scale, for a simulator that was right everywhere so far.

    Reference: Rasmussen and Williams 2006, section 5.4.1 (marginal likelihood), maximised over the signal variance.
    """
    if gp.num_points < 2:
        return
    posterior = gp.posterior
    residual = gp.targets - posterior.simulator_loc(gp.inputs)
    heads = residual.unsqueeze(0) if posterior.noise.shape[0] == 1 else residual.mT.unsqueeze(-1)
    variance = (posterior.factor.inverse @ heads).square().mean(1).flatten()
    gp.output_scale = variance.sqrt().clamp_min(smallest)
    gp.apply_schedule()
    if gp.noise_schedule.variance(gp.count) is None and gp.likelihood.noise.numel() == gp.num_outputs:
        gp.likelihood.noise = (posterior.noise * gp.output_scale.square()).reshape(gp.likelihood.noise.shape)
