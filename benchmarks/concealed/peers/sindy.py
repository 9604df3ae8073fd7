"""PySINDy on the residual force of each joint: polynomials of (q, v, u), sign(v), v|v|; thresholds by held-out runs."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pysindy

from benchmarks.concealed.peers.recorded import Recorded, answer, load, names_of

TERMS = {
    "1": "constant_force", "v": "viscous_friction", "sign(v)": "coulomb_friction", "v|v|": "quadratic_drag",
    "q": "linear_spring", "q q q": "cubic_spring",
}  # fmt: skip
THRESHOLDS = np.geomspace(0.01, 1.0, 10)


def features(r: Recorded, j: int) -> tuple[np.ndarray, list[str]]:
    """The library of one joint (N, P), with names in which `q` and `v` are its own."""
    n, m = r.q.shape[1], r.u.shape[1]
    names = [("q" if k == j else f"q{k}") for k in range(n)] + [("v" if k == j else f"v{k}") for k in range(n)]
    names += [f"u{i}" for i in range(m)]
    library = pysindy.PolynomialLibrary(degree=3 if n <= 3 else 1)
    x = np.column_stack([r.q, r.v, r.u])
    columns = np.asarray(library.fit_transform(x))
    labels = [label.replace("v^2", "v v").replace("q^3", "q q q") for label in library.get_feature_names(names)]
    v = r.v[:, j]
    return np.column_stack([columns, np.sign(v), v * np.abs(v)]), [*labels, "sign(v)", "v|v|"]


def diagnose(folder: Path) -> dict[str, Any]:
    """Each joint's sparse law; a term that has no name makes it unknown there."""
    model, train = load(folder)
    _, test = load(folder, "test")
    joints, actuators = names_of(model)
    motors = {f"u{i}": f"actuator:{name}" for i, name in enumerate(actuators)}
    effects, strange, places = [], False, []
    for j, joint in enumerate(joints):
        terms = _sparse(train, test, j)
        if terms:
            places.append(f"joint:{joint}")
        for term in terms:
            if term in TERMS:
                effects.append((TERMS[term], f"joint:{joint}"))
            elif term in motors:
                effects.append(("actuator_gain", motors[term]))
            else:
                strange = True
    return answer(list(dict.fromkeys(effects)), bool(effects) or strange, places)


def _sparse(train: Recorded, test: Recorded, j: int) -> list[str]:
    """The fewest terms whose held-out error is within 2 % of the best; none if zero terms are."""
    X, labels = features(train, j)
    held, _ = features(test, j)
    scale, size = X.std(0) + 1e-12, train.residual[:, j].std() + 1e-12
    scale[labels.index("1")] = 1.0
    y, goal = train.residual[:, j] / size, test.residual[:, j] / size
    found = [(float(np.mean(goal**2)), np.zeros(X.shape[1]))]
    for threshold in THRESHOLDS:
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-3)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            optimizer.fit(X / scale, y[:, None])
        w = np.asarray(optimizer.coef_).ravel()
        found.append((float(np.mean((goal - held / scale @ w) ** 2)), w))
    best = min(error for error, _ in found)
    w = min((w for error, w in found if error <= 1.02 * best), key=np.count_nonzero)
    return [label for label, weight in zip(labels, w, strict=True) if weight != 0]
