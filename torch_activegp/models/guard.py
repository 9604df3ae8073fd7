"""A guard that keeps the learned model from being worse than the simulator alone on held-out data."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from torch_activegp.errors import DataError
from torch_activegp.models.dynamics_gp import DynamicsGP


@dataclass(frozen=True)
class GuardReport:
    """What the guard found on held-out transitions.

    Attributes:
        simulator_rmse: one-step error of the simulator alone, ``(d,)``, in the unit of each state.
        model_rmse: one-step error of simulator + GP, ``(d,)``.
        guarded_rmse: one-step error after shrinking the correction by ``trust``, ``(d,)``.
        trust: the factor on the learned correction, ``(d,)`` in [0, 1].
        names: the states' names.
    """

    simulator_rmse: Tensor
    model_rmse: Tensor
    guarded_rmse: Tensor
    trust: Tensor
    names: tuple[str, ...]

    @property
    def stepped_in(self) -> bool:
        """Whether the correction of some state is not kept whole."""
        return bool((self.trust < 1).any())

    def __str__(self) -> str:
        """One sentence, naming the states where the guard stepped in."""
        shrunk = (self.trust < 1).nonzero().flatten().tolist()
        if torch.equal(self.model_rmse, self.simulator_rmse):
            return "No held-out data tells the learned model from the simulator alone yet."
        if not shrunk:
            return "On held-out data the learned model is better than the simulator alone in every state."
        parts = [
            f"{self.names[j]} ({self.model_rmse[j]:.3g} against {self.simulator_rmse[j]:.3g}; "
            f"{100 * self.trust[j]:.0f} % of the correction kept)"
            for j in shrunk
        ]
        worse = all(self.model_rmse[j] > self.simulator_rmse[j] for j in shrunk)
        verdict = "worse" if worse else "not reliably better"
        return (
            f"The guard stepped in: on held-out data the learned model is {verdict} than the simulator alone in "
            f"{', '.join(parts)}. Fit the hyper-parameters, or give the kernel shorter length-scales."
        )


class HeldOutGuard(nn.Module):
    """Compare model and simulator on transitions that the model has not seen, and shrink its correction where it hurts.

    Where the model beats the simulator its correction is kept whole. Elsewhere it is multiplied by the factor in
    [0, 1] that minimises the held-out squared error; 0 is the simulator alone, so the result is never worse than it.
    :meth:`observe` accumulates: in an active-learning loop, each new episode is held-out data until it is learned from.

    Args:
        num_outputs: the number of states ``d``.
        names: the states' names, for the report.

    Example:
        >>> guard = HeldOutGuard(1, ["speed"])
        >>> guard.observe(base=torch.zeros(9, 1), loc=torch.ones(9, 1), target=torch.zeros(9, 1))
        >>> guard.report().trust
        tensor([0.], dtype=torch.float64)
    """

    sums: Tensor

    def __init__(self, num_outputs: int, names: tuple[str, ...] | list[str] | None = None) -> None:
        super().__init__()
        self.names = tuple(names or (f"state {j}" for j in range(num_outputs)))
        self.register_buffer("sums", torch.zeros(4, num_outputs, dtype=torch.float64))

    def observe(self, base: Tensor, loc: Tensor, target: Tensor) -> None:
        """Add held-out predictions.

        Args:
            base: the simulator's next states, ``(n, d)``.
            loc: the model's, ``(n, d)``.
            target: the true ones, ``(n, d)``, unwrapped like ``base``.

        Raises:
            DataError: a value is not finite.
        """
        for name, values in (("base", base), ("loc", loc), ("target", target)):
            bad = ~torch.isfinite(values).all(-1)
            if bad.any():
                raise DataError(
                    f"Wanted finite held-out predictions, found NaN or infinity in `{name}`, row "
                    f"{int(bad.nonzero()[0])} of {len(values)}. Leave such transitions out."
                )
        error, correction = (target - base).to(self.sums), (loc - base).to(self.sums)
        count = error.new_full((error.shape[-1],), error.shape[0])
        parts = [error.square().sum(0), (error * correction).sum(0), correction.square().sum(0), count]
        self.sums += torch.stack(parts)

    @torch.no_grad()
    def observe_transitions(self, gp: DynamicsGP, state: Tensor, action: Tensor, next_state: Tensor) -> None:
        """Add transitions ``(n, d)``, ``(n, m)``, ``(n, d)`` that ``gp`` was not conditioned on."""
        posterior = gp.posterior
        features = posterior.features(torch.cat([state, action], dim=-1).to(gp.output_scale))
        base, target = features.simulator_loc, next_state.to(gp.output_scale)
        if gp.state_space is not None:
            target = gp.state_space.unwrap(target, base)
        self.observe(base, posterior.loc(features), target)

    def report(self) -> GuardReport:
        """Errors so far, and how much of the correction to trust."""
        squared, product, correction, count = self.sums
        best = torch.where(correction > 0, product / correction.clamp_min(1e-300), torch.ones_like(product)).clamp(0, 1)
        model = squared - 2 * product + correction
        trust = torch.where(model <= squared, torch.ones_like(best), best)
        guarded = squared - 2 * trust * product + trust.square() * correction
        rmse = [(total.clamp_min(0) / count.clamp_min(1)).sqrt() for total in (squared, model, guarded)]
        return GuardReport(rmse[0], rmse[1], rmse[2], trust, self.names)
