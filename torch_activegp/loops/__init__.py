"""Loops: explore a system and learn it."""

from torch_activegp.loops.active_learning import ActiveLearning
from torch_activegp.loops.held_out import HeldOutEpisodes
from torch_activegp.loops.record import EpisodeRecord

__all__ = ["ActiveLearning", "EpisodeRecord", "HeldOutEpisodes"]
