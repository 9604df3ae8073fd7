"""A Gaussian process on the residual force over (q, v, u): it says whether there is something, and on which joint."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from benchmarks.concealed.peers.recorded import answer, load, names_of

ROWS = 300


def diagnose(folder: Path) -> dict[str, Any]:
    """There is something where the process predicts held-out residuals better than zero does, by 3 standard errors."""
    model, train = load(folder, most=ROWS)
    _, test = load(folder, "test", most=ROWS)
    joints, _ = names_of(model)
    inputs, held = (np.column_stack([r.q, r.v, r.u]) for r in (train, test))
    scale = inputs.std(0) + 1e-12
    gains = {}
    for j, joint in enumerate(joints):
        size = train.residual[:, j].std() + 1e-12
        kernel = ConstantKernel(1.0) * RBF(np.full(inputs.shape[1], 2.0), (0.1, 1e3)) + WhiteKernel(0.5, (1e-4, 10))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            process = GaussianProcessRegressor(kernel).fit(inputs / scale, train.residual[:, j] / size)
        goal = test.residual[:, j] / size
        better = goal**2 - (goal - process.predict(held / scale)) ** 2
        gains[f"joint:{joint}"] = float(better.mean() / (better.std() / np.sqrt(len(better) / 3) + 1e-12))
    places = sorted((place for place, gain in gains.items() if gain > 3), key=gains.__getitem__, reverse=True)
    return answer([], bool(places), places)
