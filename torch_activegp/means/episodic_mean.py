"""The episodic prior: each episode's mean is the posterior that the previous episode ended with."""

from __future__ import annotations

from typing import cast

import gpytorch
import torch
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError
from torch_activegp.means.kernel_expansion import KernelExpansion, same_kernel
from torch_activegp.means.layout import evaluate_per_output, predict_mean


class EpisodicMean(gpytorch.means.Mean):
    r"""The mean m_tau of episode tau: m_1 = p0 and m_tau = mu_{tau-1, N}.

    Written out, m_tau nests one posterior for every past episode. The nest collapses: m_tau(z) = p0(z) + k(z, Z) A
    with one cumulative weight matrix A, so a query costs the same in every episode. When hyper-parameters change
    between episodes, one more term (kernel snapshot, Z, A) is kept.

    Two recursions are offered:

    * ``"paper"``: the GP is conditioned on all data with m_tau as its mean, as in the paper: from the episode's first
      point on; before it, mu_{tau, 0} = m_tau. The residuals of the same points are regressed again in every episode
      (iterated regularisation): right for noise-free data, over-fits noise.
    * ``"bayes"``: the GP is conditioned once on all data with p0 as its mean, and m_tau is only the frozen posterior
      that the discrepancy refers to. Right for recordings.

    Args:
        base_mean: the first episode's mean p0, usually a :class:`~torch_activegp.means.SimulatorMean`; any gpytorch
            mean of batch shape ``()`` or ``(d,)``.
        recursion: ``"paper"`` or ``"bayes"``.
        num_outputs: ``d``; needed only where ``base_mean`` has no batch shape.

    Raises:
        ConfigurationError: unknown recursion, or ``d`` cannot be known.

    Example:
        >>> mean = EpisodicMean(gpytorch.means.ZeroMean(batch_shape=torch.Size([2])))
        >>> mean.reference(torch.zeros(5, 3)).shape  # nothing learned yet: the base mean
        torch.Size([5, 2])

    Reference: Miller et al. 2024 (arXiv 2403.17233), section III.
    """

    def __init__(
        self, base_mean: gpytorch.means.Mean, recursion: str = "paper", num_outputs: int | None = None
    ) -> None:
        super().__init__()
        if recursion not in ("paper", "bayes"):
            raise ConfigurationError(f"Wanted recursion 'paper' or 'bayes', found {recursion!r}.")
        batch_shape = getattr(base_mean, "batch_shape", torch.Size())
        if num_outputs is None and not batch_shape:
            raise ConfigurationError(
                f"{type(base_mean).__name__} does not say how many outputs it has. Pass num_outputs=..., or give the "
                "mean a batch_shape."
            )
        self.base_mean = base_mean
        self.recursion = recursion
        self.batch_shape = torch.Size([num_outputs or batch_shape[-1]])
        self.expansions = nn.ModuleList()

    @property
    def num_outputs(self) -> int:
        """The number of outputs ``d``."""
        return self.batch_shape[0]

    def base(self, z: Tensor) -> Tensor:
        """The first episode's mean p0 at ``z`` ``(n, D)``: ``(n, d)``."""
        return predict_mean(self.base_mean, z, self.num_outputs)

    def reference(self, z: Tensor) -> Tensor:
        """The episode's prior m_tau at ``z`` ``(n, D)``: ``(n, d)``."""
        return self.base(z) + sum(expansion(z) for expansion in self.expansions)

    def predict(self, z: Tensor) -> Tensor:
        """The mean that the GP is conditioned with, at ``z`` ``(n, D)``: ``(n, d)``."""
        return self.base(z) if self.recursion == "bayes" else self.reference(z)

    def forward(self, x: Tensor) -> Tensor:
        """The conditioning mean in gpytorch's layout: ``(n, D)`` or ``(d, n, D)`` to ``(d, n)``."""
        return evaluate_per_output(self._predict_batched, x, self.num_outputs)

    def _predict_batched(self, x: Tensor) -> Tensor:
        return self.predict(x.reshape(-1, x.shape[-1])).reshape(*x.shape[:-1], self.num_outputs)

    def advance(self, kernel: gpytorch.kernels.Kernel, centers: Tensor, weights: Tensor) -> None:
        """Make the posterior the mean of the next episode.

        Args:
            kernel: the kernel that the posterior was computed with.
            centers: all points so far, ``(n, D)``.
            weights: the posterior's cumulative weights A (see :meth:`inner`), ``(h, n, d / h)``.
        """
        kept = [] if self.recursion == "bayes" else self.outer(kernel, centers)
        self.expansions = nn.ModuleList([*kept, KernelExpansion(kernel, centers, weights)])

    def inner(self, kernel: gpytorch.kernels.Kernel, centers: Tensor) -> KernelExpansion | None:
        """The last term, if its weights can be merged with those of a posterior at ``centers`` ``(n, D)``.

        They can if the term has this kernel, and its own centers come first among ``centers``.
        """
        if not len(self.expansions):
            return None
        last = cast(KernelExpansion, self.expansions[-1])
        merges = torch.equal(last.centers, centers[: len(last.centers)]) and same_kernel(last.kernel, kernel)
        return last if merges else None

    def outer(self, kernel: gpytorch.kernels.Kernel, centers: Tensor) -> list[KernelExpansion]:
        """The terms that cannot be merged: made with other hyper-parameters, or at points that were dropped."""
        inner = self.inner(kernel, centers)
        return [cast(KernelExpansion, term) for term in self.expansions if term is not inner]

    def allocate(self, kernel: gpytorch.kernels.Kernel, shapes: list[tuple[torch.Size, torch.Size]]) -> None:
        """Make room for terms that a state dict brings: one pair of shapes (centers, weights) each."""
        like = next(iter(kernel.parameters()), torch.zeros((), dtype=torch.float64))
        self.expansions = nn.ModuleList(
            KernelExpansion(kernel, like.new_zeros(centers), like.new_zeros(weights)) for centers, weights in shapes
        )
