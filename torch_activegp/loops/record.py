"""What one episode of active learning achieved."""

from __future__ import annotations

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
        trust: for each state, the factor on the learned correction that held-out steps support (1: all of it).
        metrics: what the loop's ``evaluate`` returned.
    """

    index: int
    num_points: int
    max_variance: float
    discrepancy: float
    seconds: float
    trust: tuple[float, ...]
    metrics: dict[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for a checkpoint or a table."""
        return asdict(self)

    def __str__(self) -> str:
        """One line."""
        extra = "".join(f", {name} {value:.4g}" for name, value in self.metrics.items())
        guard = "" if min(self.trust, default=1.0) >= 1 else ", guard stepped in"
        return (
            f"episode {self.index}: {self.num_points} points, max variance {self.max_variance:.3g}, "
            f"discrepancy {self.discrepancy:.3g}{extra}{guard} ({self.seconds:.1f} s)"
        )
