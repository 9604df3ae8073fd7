"""The command line ``torch-activegp``."""

from torch_activegp.cli import demo, diagnose, evaluate, explore, figures, learn
from torch_activegp.cli.app import app, main

__all__ = ["app", "demo", "diagnose", "evaluate", "explore", "figures", "learn", "main"]
