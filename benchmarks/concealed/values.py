"""Were the parameters right, and did their intervals hold the truth?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.concealed.places import normal
from benchmarks.concealed.translation import described

NEUTRAL = {"gain": 1.0}
"""The value at which a parameter does nothing, where that is not 0: errors are relative to the distance from it."""

NO_ZERO = ("phase", "rest", "position")
"""Parameters whose zero means nothing: a relative error would not either, only their intervals count."""

SLIDES = {"slide": 1, "striker": 1, "cartpole": 1}
"""How many of a machine's first joints slide."""
MILLIMETRE = 0.3
"""On a slide, so many mm of noise stand for a mrad."""


def score_values(key: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Relative error (None without a zero) and whether the interval covers, for each parameter that both name."""
    rows = []
    for truth in key["effects"]:
        words = described(truth)
        for effect in diagnosis.get("effects") or []:
            if normal(effect["name"], effect["target"]) != normal(truth["name"], truth["target"]):
                continue
            for name, entry in (effect.get("parameters") or {}).items():
                other = key["loop"] == "servo" and name == "limit" and entry.get("unit") == "1"  # of the command
                if name in words and not other:
                    rows.append({"effect": truth["name"], "parameter": name, **_compare(name, entry, words[name])})
    return rows


def _compare(name: str, entry: Mapping[str, Any], true: float) -> dict[str, Any]:
    value, interval = float(entry["value"]), entry.get("ci95")
    shift = 2 * np.pi * round((true - value) / (2 * np.pi)) if name == "phase" else 0.0
    size = max(abs(true - NEUTRAL.get(name, 0.0)), 1e-12)
    error = None if name in NO_ZERO else abs(value - true) / size
    covered = None
    if interval is not None and np.isfinite(interval).all():
        covered = bool(interval[0] + shift <= true <= interval[1] + shift)
    return {"error": error, "covered": covered}


def noise_of(key: Mapping[str, Any]) -> float:
    """The largest noise of a case, in mrad or what stands for it on a slide."""
    slides = SLIDES.get(key["system"], 0)
    deviations = key["noise"].values()
    return 1e3 * max(value / (MILLIMETRE if joint < slides else 1.0) for joint, value in enumerate(deviations))
