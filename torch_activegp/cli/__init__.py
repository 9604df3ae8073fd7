"""The command line ``torch-activegp``."""

from torch_activegp.cli import explore, figures, learn
from torch_activegp.cli.app import app, main

__all__ = ["app", "explore", "figures", "learn", "main"]
