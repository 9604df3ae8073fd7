"""The command line ``torch-activegp``."""

from torch_activegp.cli.app import app, main

__all__ = ["app", "main"]
