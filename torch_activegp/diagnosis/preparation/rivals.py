"""The precise forms of a model where they compete: what each leaves that no initial state takes away."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine

_TRIALS = 3
"""Lengths of step that are simulated at most."""
_FAR_OFF = 2.0
"""Times the least chi2 from which on a form in long steps is too far off to tell of short ones."""
_ALIKE, _ALIKE_ABRUPT = 1.0, 0.25
"""Chi2 by which two forms differ that nothing tells apart, and where something sticks."""

_BEHIND, _FAR_BEHIND, _BARE_BEHIND = 0.02, 50.0, 10.0
"""Where one leaves noise alone, others are not fitted that cost more to first order: by a part of its cost and so much
chi2 (parameters may move far, and the model's own form comes before others), or by so much where initial states alone
are fitted. Not where something touches or sticks, nor behind a delay of few steps, which is longer by a form that has
controls early: behind drag and two of half a step Runge-Kutta was not tried, which wanted drag alone."""


@dataclasses.dataclass(frozen=True, eq=False)
class Rival:
    """A precise form where the competition begins.

    Args:
        engine: the form.
        exact: what it predicts there, ``(S, K + 1, C)``.
        left: chi2 that no change of the initial states takes away, to first order.
        least: chi2 that none of the parameters does either.
    """

    engine: Engine
    exact: Array
    left: float
    least: float

    @classmethod
    def at(cls, shooting: Shooting, engine: Engine, rough: Fit) -> Self:
        """A form at a fit."""
        return cls.saying(dataclasses.replace(shooting, engine=engine).predicted(rough), engine, shooting, rough)

    @classmethod
    def saying(cls, exact: Array, engine: Engine, shooting: Shooting, rough: Fit) -> Self:
        """A form that predicts this at a fit."""
        assert rough.design is not None
        white = beside(rough.design, shooting.residuals(exact))
        both = float((white**2).sum()), _unexplained(rough, white)
        left, least = (chi2 if np.isfinite(chi2) else np.inf for chi2 in both)
        return cls(engine, exact, left, least)


def distinct(rivals: Sequence[Rival], shooting: Shooting, rough: Fit, abrupt: bool = False) -> list[Rival]:
    """Those of some rivals that can be told from all that come before them.

    Args:
        rivals: the one to keep of several that are alike comes first.
        shooting: the likelihood.
        rough: the fit at which they compete.
        abrupt: whether something in it sticks, so that little may grow as the fits go on.
    """
    assert rough.design is not None
    kept: list[Rival] = []
    alike = _ALIKE_ABRUPT if abrupt else _ALIKE
    for rival in rivals:
        apart = (shooting.noise.whiten(shooting.segments, rival.exact - other.exact) for other in kept)
        if not any(_unexplained(rough, beside(rough.design, white)) < alike for white in apart):
            kept.append(rival)
    return kept


def closest_by_one(
    forms: Sequence[Engine],
    rivals: Sequence[Rival],
    fine: Engine,
    shooting: Shooting,
    rough: Fit,
    least: float = np.inf,
) -> list[Rival]:
    """Of forms of one scheme of first order, in steps of several lengths, those that seemed the closest one in turn.

    What they are off grows with the step. So one length tells of the others where nothing sticks or strikes, and the
    closest of them, once it is simulated, tells it better.

    Args:
        forms: of the scheme; the first one is simulated where no rival is of it.
        rivals: what was simulated; what cannot be told from one of them is not sought.
        fine: of them the one that is nearly continuous in time.
        shooting: the likelihood.
        rough: the fit at which they compete.
        least: chi2 from which on none is of interest.
    """
    exact = next(rival.exact for rival in rivals if rival.engine is fine)
    of_scheme = (rival for rival in rivals if rival.engine.scheme == forms[0].scheme and rival.engine is not fine)
    known = next((rival for rival in of_scheme if np.isfinite(rival.left)), None)
    known, found = known or Rival.at(shooting, forms[0], rough), list[Rival]()
    while len(found) < _TRIALS:
        off = (known.exact - exact) * known.engine.substeps
        said = [Rival.saying(exact + off / form.substeps, form, shooting, rough) for form in forms]
        new = [rival for rival in distinct([*rivals, *said], shooting, rough) if rival in said]
        likely = min(new, key=lambda rival: rival.left, default=None)
        form = None if likely is None or likely.left >= least else likely.engine
        if form is None and not found and not known.left < _FAR_OFF * least:  # so far off it says little of the others
            form = forms[len(forms) // 2]
        if form is None or form in (rival.engine for rival in found):
            break
        known = Rival.at(shooting, form, rough)
        found.append(known)
    return sorted(found, key=lambda rival: -rival.left)


def too_far(results: Sequence[tuple[float, *tuple[object, ...], float]], much: bool) -> float:
    """The cost, as it is seen to first order, from which on a form is not fitted, whether by much.

    Else it is compared with what was expected of the best one: its fit gained more than was seen to first order, and so
    may others' fits.

    Args:
        results: cost of each form that was fitted, anything, and what it was seen to cost to first order.
        much: whether a form must be seen to cost much more.
    """
    cost, *_, expected = min(results, key=lambda result: result[0])
    return cost + _BEHIND * cost + _FAR_BEHIND if much else max(cost, expected) + _BARE_BEHIND


def _unexplained(fit: Fit, left: Array) -> float:
    """Chi2 of columns beside the initial states, ``(S, M)``, that no change of the parameters of a fit makes either."""
    assert fit.design is not None
    if fit.columns is None or not fit.columns.any() or not np.isfinite(left).all():
        return float((left**2).sum())
    moved = np.stack([beside(fit.design, column) for column in np.moveaxis(fit.columns, -1, 0)], axis=-1)
    moved = moved.reshape(-1, moved.shape[-1])
    best = np.linalg.lstsq(moved, left.ravel(), rcond=None)[0]
    return float(((left.ravel() - moved @ best) ** 2).sum())


def beside(design: Array, white: Array) -> Array:
    """What some derivatives ``(S, M, n)`` do not make of whitened columns ``(S, M)``."""
    basis, _ = np.linalg.qr(design[..., design.any(axis=(0, 1))])
    return np.asarray(white - np.einsum("smn,sn->sm", basis, np.einsum("smn,sm->sn", basis, white)))
