"""Whether one form of a model may stand in for another one, with its error taken out where a fit ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.chaining import chained
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.readings import readings

_CLOSE = 30.0
"""How far forms may be apart, in units of the noise, but for what initial states absorb."""
_ROUGHLY = 0.1
"""Where a fit leaves much more than the noise, an error of so much of what it leaves is close too."""
_STEADY = 0.05
"""Chi2 per degree of freedom by which a correction may be off at other initial states, and more where much is left.
On 11 machines with good corrections it was 0.012 at most. On an arm of two joints whose coarse form was up to 290 times
the noise off, it was 0.2 to 0.4: the true cogging left more than nothing did, and nine names came first."""
_SETTLED = 0.01
"""Part of chi2 by which a correction must change a fit for another one."""
_ROUNDS = 6
"""Corrections of a form at most, while its fit gets better and leaves little more than noise; else two."""
_CREEPS = 20
"""Rounds of a fit by which forms are compared: what creeps further, as on a machine that strikes, does so by any."""
_SAME = 0.02
"""Part of chi2 by which fits may differ that are called the same."""
_MUCH = 2.0
"""Times the noise: what leaves less is near it."""
_ALIKE = 1.0
"""Chi2 by which two forms differ that nothing tells apart."""


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
        assert rough.design is not None
        exact = dataclasses.replace(shooting, engine=engine).predicted(rough)
        white = _beside(rough.design, shooting.residuals(exact))
        both = float((white**2).sum()), _unexplained(rough, white)
        left, least = (chi2 if np.isfinite(chi2) else np.inf for chi2 in both)
        return cls(engine, exact, left, least)


def distinct(rivals: Sequence[Rival], shooting: Shooting, rough: Fit) -> list[Rival]:
    """Those of some rivals that can be told from all that come before them.

    Args:
        rivals: the one to keep of several that are alike comes first.
        shooting: the likelihood.
        rough: the fit at which they compete.
    """
    assert rough.design is not None
    kept: list[Rival] = []
    for rival in rivals:
        apart = (shooting.noise.whiten(shooting.segments, rival.exact - other.exact) for other in kept)
        if not any(_unexplained(rough, _beside(rough.design, white)) < _ALIKE for white in apart):
            kept.append(rival)
    return kept


def first_close(
    precise: Shooting,
    forms: Sequence[Engine],
    begin: Fit,
    exact: Fit | None,
    predicted: Array | None = None,
    lost: float = np.inf,
) -> tuple[Shooting, Fit]:
    """The first form that stays close to a precise one, the last of them, corrected by it; and its fit.

    Where the precise form was fitted (`exact`), what stands in must fit as well. `predicted` is what it says where the
    fits begin, where that is known; nothing more is done from a chi2 of `lost` on. What takes longer steps than a form
    of the same scheme that was not close is not tried.
    """
    engine, working, judged = precise.engine, precise, begin
    tried: dict[tuple[bool, int], float] = {}
    for cheap in forms:
        scheme, steps = (cheap.late, int(cheap.model.opt.integrator)), cheap.steps_in(precise.segments)
        if steps < tried.get(scheme, 0.0) and cheap is not engine:
            continue
        tried[scheme] = steps
        if cheap is engine and exact is not None:
            return precise, exact
        known = predicted if judged is begin else None
        working, judged = settled(dataclasses.replace(precise, engine=cheap), engine, judged, known, lost)
        if not np.isfinite(judged.chi2) and cheap is not engine:
            judged = exact or begin
            continue
        if judged.chi2 > lost or working.offset is None or is_close(working, judged, exact or engine):
            break
        judged = exact or judged
    return working, judged


def settled(
    working: Shooting, engine: Engine, judged: Fit, exact: Array | None = None, lost: float = np.inf
) -> tuple[Shooting, Fit]:
    """A form corrected by an engine where its own fit ends, and that fit; only the first one where that is lost.

    It begins from a fit, where what the engine predicts may be known (`exact`), and ends from a chi2 of `lost` on.
    """
    for number in range(_ROUNDS):
        before = judged.chi2
        working, exact = working.corrected(engine, judged, exact), None
        judged = working.fit([(judged.effects, judged.values)], judged.starts, _CREEPS, near=judged)[0]
        if judged.chi2 > lost:
            return working, judged
        if working.engine is engine:  # no correction to take anew
            break
        changed = before - judged.chi2
        near = judged.chi2 < _MUCH * working.dof and changed > 0.0
        if abs(changed) < _SETTLED * judged.chi2 or (number and not near):
            break
    return working, chained(working, judged) if np.isfinite(judged.chi2) else judged


def is_close(working: Shooting, judged: Fit, exact: Fit | Engine) -> bool:
    """Whether a corrected form stays close to the precise one.

    Args:
        working: the likelihood by the form.
        judged: its fit.
        exact: that of the precise form, which must be no better; or the precise form itself. That must agree then, but
            for what initial states absorb, by the same from other initial states, and near the noise explain as much
            where the fit has ended: a correction for a joint that sticks and slips may hold for the point alone at
            which it was taken.
    """
    slack = same(working, judged.chi2)
    if isinstance(exact, Fit):
        return judged.chi2 < exact.chi2 + slack
    if unabsorbed(working, judged) >= bar(working, judged):
        return False
    precise = dataclasses.replace(working, engine=exact, offset=None)
    if drift(working, precise, judged) > _STEADY * max(float(working.dof), _ROUGHLY * judged.chi2):
        return False
    if judged.chi2 > _MUCH * working.dof:
        return True
    return float((precise.residual_of(judged) ** 2).sum()) < judged.chi2 + slack


def same(shooting: Shooting, chi2: float) -> float:
    """How much two values of chi2 may differ that are called the same."""
    return _SAME * max(chi2, float(shooting.dof))


def bar(shooting: Shooting, fit: Fit) -> float:
    """How far a form may be from another one, in units of the noise."""
    return _CLOSE * max(1.0, _ROUGHLY * float(np.sqrt(fit.chi2 / shooting.dof)))


def unabsorbed(shooting: Shooting, fit: Fit) -> float:
    """The largest part of the offset that no change of the initial states makes, in units of the noise."""
    assert shooting.offset is not None
    assert fit.design is not None
    offset = np.nan_to_num(shooting.noise.whiten(shooting.segments, shooting.offset))
    return float(np.abs(_beside(fit.design, offset)).max())


def drift(working: Shooting, precise: Shooting, fit: Fit) -> float:
    """Chi2 of the error that a corrected form has from where the recordings seem to begin.

    Those states are about as far from a fit's as what is missing has moved them; so far may a correction be carried
    while it is sought. What is not recorded stays where the fit has it, and what initial states absorb is not counted.

    Args:
        working: the likelihood by the form, with its correction.
        precise: that by the precise form.
        fit: where the correction was taken; its derivatives are there.

    Returns:
        Infinity where one of the forms fails and the other does not.
    """
    assert working.offset is not None
    assert fit.design is not None
    other = dataclasses.replace(fit, starts=_as_recorded(working, fit))
    exact, rough = precise.predicted(other), working.predicted(other)
    failed, lost = (np.isnan(some).any(axis=(1, 2)) for some in (exact, rough))
    if (failed != lost).any():
        return float("inf")
    white = np.nan_to_num(working.noise.whiten(working.segments, exact - rough - working.offset))
    return float((_beside(fit.design, white) ** 2).sum())


def _as_recorded(shooting: Shooting, fit: Fit) -> Array:
    """The states of a fit, moved to where the recorded joints seem to begin, ``(S, nq + nv)``."""
    segments, places = shooting.segments, shooting.engine.channels.qpos
    speeds = shooting.engine.model.nq + shooting.engine.channels.dof
    seen, states = shooting.engine.starts(segments), fit.starts.copy()
    position, velocity = (np.repeat(states[None, :, None, where], 2, axis=2) for where in (places, speeds))
    read = readings([fit.candidate], position, velocity, segments.dt[:, :1])[0, :, 0]
    states[:, places] += seen[:, places] - read
    states[:, speeds] = seen[:, speeds]
    return states


def _unexplained(fit: Fit, left: Array) -> float:
    """Chi2 of columns beside the initial states, ``(S, M)``, that no change of the parameters of a fit makes either."""
    assert fit.design is not None
    if fit.columns is None or not fit.columns.any() or not np.isfinite(left).all():
        return float((left**2).sum())
    moved = np.stack([_beside(fit.design, column) for column in np.moveaxis(fit.columns, -1, 0)], axis=-1)
    moved = moved.reshape(-1, moved.shape[-1])
    best = np.linalg.lstsq(moved, left.ravel(), rcond=None)[0]
    return float(((left.ravel() - moved @ best) ** 2).sum())


def _beside(design: Array, white: Array) -> Array:
    """What some derivatives ``(S, M, n)`` do not make of whitened columns ``(S, M)``."""
    basis, _ = np.linalg.qr(design[..., design.any(axis=(0, 1))])
    return np.asarray(white - np.einsum("smn,sn->sm", basis, np.einsum("smn,sm->sn", basis, white)))
