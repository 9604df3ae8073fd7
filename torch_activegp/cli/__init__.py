"""The command line ``torch-activegp``."""

from torch_activegp.cli import demo, diagnose, diagnose_all, evaluate, explore, figures, learn
from torch_activegp.cli.app import app, main

__all__ = ["app", "demo", "diagnose", "diagnose_all", "evaluate", "explore", "figures", "learn", "main"]
