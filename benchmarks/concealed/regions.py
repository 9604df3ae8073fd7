"""How well the marked region of the mismatch tells the rows where a local effect acts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from benchmarks.concealed.places import joints_of


def score_regions(key: Mapping[str, Any], diagnosis: Mapping[str, Any], cases: Path) -> tuple[list[float], list[float]]:
    """For each local effect: the area under the curve with which the region tells its rows, and their share."""
    areas, shares = [], []
    for effect in key["effects"]:
        if not effect.get("region"):
            continue
        joints = joints_of(effect["target"], key)
        places = [place for place in diagnosis.get("location") or [] if joints_of(place["target"], key) & joints]
        table = pd.concat([pd.read_csv(path) for path in sorted((cases / key["case"]).glob("train_*.csv"))])
        inside = _inside(table, effect["region"])
        shares.append(float(inside.mean()))
        if inside.any() and not inside.all():
            marked = [_inside(table, place.get("region") or {}) for place in places]
            guess = np.any(marked, axis=0) if marked else np.ones(len(table), bool)
            areas.append(area(inside, guess.astype(float)))
    return areas, shares


def _inside(table: pd.DataFrame, region: Mapping[str, Sequence[float]]) -> np.ndarray:
    inside = np.ones(len(table), bool)
    for name, (low, high) in region.items():
        plain = name.strip("|")
        if plain in table:
            values = table[plain].to_numpy()
        elif plain.replace("qvel", "qpos") in table:  # no tachometer: differences over five rows
            q, t = table[plain.replace("qvel", "qpos")].to_numpy(), table["time"].to_numpy()
            values = np.zeros(len(q))
            values[2:-2] = (q[4:] - q[:-4]) / np.maximum(t[4:] - t[:-4], 1e-9)
        else:
            continue
        values = np.abs(values) if name.startswith("|") else values
        inside &= (values >= low) & (values <= high)
    return inside


def area(truth: np.ndarray, score: np.ndarray) -> float:
    """Area under the receiver's curve; ties count one half."""
    ranks, positive = rankdata(score), int(truth.sum())
    return float((ranks[truth].sum() - positive * (positive + 1) / 2) / (positive * (len(truth) - positive)))
