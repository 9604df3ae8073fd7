"""What one episode of active learning achieved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class EpisodeRecord:
    """One episode of :class:`~torch_activegp.loops.ActiveLearning`.

    Attributes:
        index: number of the episode, from 1.
        num_points: transitions learned from so far.
        max_variance: largest posterior variance after the episode, in units of the squared output scale.
        discrepancy: mean over the visited points of |p0 - f|, Euclidean over the states, in their units.
        seconds: wall-clock time of the episode.
        trust: for each state, the factor on the learned correction in the loop's ``model``: 1, or 0 where held-out
            episodes do not show that it pays.
        metrics: what the loop's ``evaluate`` returned.

    Example:
        >>> print(EpisodeRecord(1, 10, 0.5, 0.25, 2.0, (1.0, 0.0), {"mse": 0.125}))
        episode 1: 10 points, max variance 0.5, discrepancy 0.25, mse 0.125, guard stepped in (2.0 s)
    """

    index: int
    num_points: int
    max_variance: float
    discrepancy: float
    seconds: float
    trust: tuple[float, ...]
    metrics: dict[str, float] = field(default_factory=dict)

    @property
    def guard_stepped_in(self) -> bool:
        """Whether the correction of some state is left out, because held-out episodes do not show that it pays."""
        return any(factor < 1 for factor in self.trust)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for a checkpoint or a table."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> EpisodeRecord:
        """The record that :meth:`as_dict` was called on, also after a journey through JSON."""
        return cls(**{**values, "trust": tuple(values["trust"])})

    def __str__(self) -> str:
        """One line; a metric called like one of the record's own figures stands in for it."""
        figures = {"max_variance": self.max_variance, "discrepancy": self.discrepancy, **self.metrics}
        shown = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in figures.items())
        guard = ", guard stepped in" if self.guard_stepped_in else ""
        return f"episode {self.index}: {self.num_points} points, {shown}{guard} ({self.seconds:.1f} s)"
