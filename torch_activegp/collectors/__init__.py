"""Collectors: where episodes start, and how they reach the replay buffer."""

from torch_activegp.collectors.episode_start import EpisodeStart
from torch_activegp.collectors.episodes import EpisodeCollector
from torch_activegp.collectors.error_reduction import LargestErrorReductionStart
from torch_activegp.collectors.start import LargestScoreStart

__all__ = ["EpisodeCollector", "EpisodeStart", "LargestErrorReductionStart", "LargestScoreStart"]
