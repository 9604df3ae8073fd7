"""One step of the cross-entropy method: the best candidates, and a Gaussian moved towards them."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class EliteFit(nn.Module):
    """Pick the candidates of largest return and move mean and std towards theirs.

    Candidates with return -inf are never elites: where fewer than ``top_k`` others exist, only those count, and a row
    without any keeps its mean and std. The std is that of the elites themselves (divided by their number), so a single
    elite gives 0 and not NaN; momentum acts on the std, not on the variance.

    Args:
        top_k: number of elites.
        momentum: share of the old mean and std that is kept.
        dtype: floating type of the candidates.

    Reference:
        Pinneri et al. 2020, Algorithm 1 (momentum alpha), arXiv 2008.06389.

    Example:
        >>> candidates = torch.tensor([[[1.0]], [[2.0]], [[4.0]]])
        >>> fit = EliteFit(top_k=2, momentum=0.0, dtype=torch.float32)
        >>> elites, scores, mean, std = fit(candidates, torch.tensor([0.0, 9.0, 5.0]), *torch.ones(2, 1, 1, 1))
        >>> scores.tolist(), mean.item(), std.item()
        ([9.0, 5.0], 3.0, 1.0)
    """

    even: Tensor

    def __init__(self, top_k: int, momentum: float = 0.1, dtype: torch.dtype = torch.float64) -> None:
        super().__init__()
        self.top_k = top_k
        self.share = 1.0 - momentum
        self.register_buffer("even", torch.full((1, top_k), 1.0 / top_k, dtype=dtype), persistent=False)

    def forward(
        self, actions: Tensor, returns: Tensor, mean: Tensor, std: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Fit the elites of each row.

        Args:
            actions: candidates, ``(*B, C, H, m)``, C at least ``top_k``.
            returns: ``(*B, C)``, -inf for those that are not allowed or not finite.
            mean: old mean, broadcastable to ``(*B, 1, H, m)``.
            std: old standard deviation, in the same form.

        Returns:
            Elites, best first, ``(*B, top_k, H, m)``, the best one in place of those with return -inf; their returns,
            ``(*B, top_k)``; the new mean and std, ``(*B, 1, H, m)``.
        """
        scores, index = returns.topk(self.top_k, dim=-1)
        index, weight, gain = self._weigh(scores, index)
        elites = actions.gather(-3, index[..., None, None].expand(*index.shape, *actions.shape[-2:]))
        flat = elites.flatten(-2)
        centre = weight @ flat
        spread = (weight @ (flat - centre).square()).sqrt()
        shape = (*index.shape[:-1], 1, *actions.shape[-2:])
        mean = torch.lerp(mean.expand(shape), centre.view(shape), gain)
        std = torch.lerp(std.expand(shape), spread.view(shape), gain)
        return elites, scores, mean, std

    def _weigh(self, scores: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor | float]:
        """Return the index with the best in place of the lost, weights ``(*B, 1, top_k)``, and the step to take."""
        even = self.even
        if bool((scores[..., -1] > -torch.inf).all()):  # falling order: the last one decides
            return index, even.expand(*scores.shape[:-1], 1, self.top_k), self.share
        finite = scores > -torch.inf
        weight = finite.to(even.dtype)
        count = weight.sum(-1, keepdim=True)
        gain = (count.clamp(max=1.0) * self.share)[..., None, None]
        weight = (weight / count.clamp(min=1.0)).unsqueeze(-2)
        return torch.where(finite, index, index[..., :1]), weight, gain
