"""The inverse of a Cholesky factor, kept so that points can be appended and variances are matrix products."""

from __future__ import annotations

from itertools import pairwise

import torch
from linear_operator.utils.cholesky import psd_safe_cholesky
from torch import Tensor

_BLOCK = 128


class InverseFactor:
    """L^-1 of a positive definite S = L L^T, with ``h`` heads.

    Storage grows by doubling, so that an append costs O(n^2) arithmetic and rarely copies.

    Args:
        matrix: S, ``(h, n, n)``.
    """

    def __init__(self, matrix: Tensor) -> None:
        factor = psd_safe_cholesky(matrix)
        eye = torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
        self.size = matrix.shape[-1]
        self._storage = torch.linalg.solve_triangular(factor, eye.expand_as(factor), upper=False)

    @property
    def inverse(self) -> Tensor:
        """L^-1, lower triangular, ``(h, n, n)``."""
        return self._storage[:, : self.size, : self.size]

    def append(self, cross: Tensor, corner: Tensor) -> tuple[Tensor, Tensor]:
        """Add one row and column to S.

        Args:
            cross: the new column without its last entry, ``(h, n)``.
            corner: the new diagonal entry, ``(h,)``.

        Returns:
            The new row of L without its last entry ``(h, n)``, and that last entry ``(h,)``.

        Raises:
            torch.linalg.LinAlgError: S would no longer be positive definite.
        """
        row = (self.inverse @ cross.unsqueeze(-1)).squeeze(-1)
        squared = corner - row.square().sum(-1)
        if not bool((squared > 0).all()):
            raise torch.linalg.LinAlgError("The appended matrix is not positive definite; recompute the factor.")
        pivot = squared.sqrt()
        self._reserve(self.size + 1)
        self._storage[:, self.size, : self.size] = -(row.unsqueeze(-2) @ self.inverse).squeeze(-2) / pivot.unsqueeze(-1)
        self._storage[:, self.size, self.size] = pivot.reciprocal()
        self.size += 1
        return row, pivot

    def _reserve(self, size: int) -> None:
        capacity = self._storage.shape[-1]
        if size <= capacity:
            return
        grown = self._storage.new_zeros(self._storage.shape[0], 2 * size, 2 * size)
        grown[:, :capacity, :capacity] = self._storage
        self._storage = grown

    def whiten(self, rows: Tensor) -> Tensor:
        """Rows times L^-T in blocks that skip the zero half: ``(h, n', n)`` to ``(h, n', n)``."""
        return torch.cat([rows[..., :stop] @ block.mT for stop, block in self._blocks()], dim=-1)

    def squared_norm(self, rows: Tensor) -> Tensor:
        """|L^-1 k|^2 for every row k: ``(h, n', n)`` to ``(h, n')``, in blocks that skip the zero half."""
        parts = [
            torch.linalg.vector_norm(rows[..., :stop] @ block.mT, dim=-1).square() for stop, block in self._blocks()
        ]
        return parts[0] if len(parts) == 1 else torch.stack(parts).sum(0)

    def _blocks(self) -> list[tuple[int, Tensor]]:
        inverse = self.inverse
        count = max(1, round(self.size / _BLOCK))
        edges = [round(self.size * i / count) for i in range(count + 1)]
        return [(stop, inverse[:, start:stop, :stop]) for start, stop in pairwise(edges)]
