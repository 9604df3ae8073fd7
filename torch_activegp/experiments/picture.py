"""How all pictures look, and how they are written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from torch_activegp.experiments.output import atomic

LOOK: dict[Any, Any] = {
    "svg.hashsalt": "torch_activegp",
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
}
"""Settings for ``matplotlib.rc_context``."""


def save_picture(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as PNG and SVG; the same bytes for the same figure.

    Args:
        figure: drawn under :data:`LOOK`.
        stem: path without ending.

    Returns:
        The files.

    Raises:
        ConfigurationError: the folder cannot be written.
    """
    files = [stem.with_suffix(suffix) for suffix in (".png", ".svg")]
    for path in files:
        metadata = {"Date": None, "Creator": "torch-activegp"} if path.suffix == ".svg" else {"Software": None}
        with atomic(path) as file:
            figure.savefig(file, format=path.suffix[1:], dpi=150, metadata=metadata)
    return files
