"""Whether one form of a model may stand in for another one, with its error taken out where a fit ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.shooting.chaining import chained
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import LENDS, Shooting
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


def cheaper(some: Sequence[Engine], engine: Engine, segments: Segments) -> list[Engine]:
    """Those of some forms that take no more time steps than an engine, and that engine last."""
    most = engine.steps_in(segments)
    forms = [form for form in dict.fromkeys((*some, engine)) if form.steps_in(segments) <= most]
    return forms[: forms.index(engine) + 1]


def first_close(
    precise: Shooting,
    forms: Sequence[Engine],
    begin: Fit,
    exact: Fit | None,
    predicted: Array | None = None,
    lost: float = np.inf,
    known: Engine | None = None,
    rest: bool = True,
) -> tuple[Shooting, Fit]:
    """The first form that stays close to a precise one, the last of them, corrected by it; and its fit.

    Where the precise form was fitted (`exact`), what stands in must fit as well, and take a third of the steps at most:
    on a slide that strikes, a form in half of them took 14 million to fit, in vain. `predicted` is what it says where
    the fits begin, where that is known; nothing more is done from a chi2 of `lost` on. What takes longer steps than a
    form of the same scheme that was not close is not tried. A form that is `known` to be close on a part of the data
    may be carried from one state to another, and need not show it on all. For `rest` see :func:`settled`.
    """
    engine, working, judged = precise.engine, precise, begin
    tried: dict[tuple[bool, int, bool], float] = {}
    for cheap in forms:
        scheme, steps = cheap.scheme, cheap.steps_in(precise.segments)
        dear = exact is not None and LENDS * steps > engine.steps_in(precise.segments)
        if (steps < tried.get(scheme, 0.0) or dear) and cheap is not engine:
            continue
        tried[scheme] = steps
        if cheap is engine and exact is not None:
            return precise, exact
        said = predicted if judged is begin else None
        working, judged = settled(dataclasses.replace(precise, engine=cheap), engine, judged, said, lost, rest)
        if not np.isfinite(judged.chi2) and cheap is not engine:
            judged = exact or begin
            continue
        if judged.chi2 > lost or working.offset is None or is_close(working, judged, exact or engine, cheap is known):
            break
        judged = exact or judged
    return working, judged


def settled(
    working: Shooting,
    engine: Engine,
    judged: Fit,
    exact: Array | None = None,
    lost: float = np.inf,
    rest: bool = True,
) -> tuple[Shooting, Fit]:
    """A form corrected by an engine where its own fit ends, and that fit; only the first one where that is lost.

    It begins from a fit, where what the engine predicts may be known (`exact`), and ends from a chi2 of `lost` on.
    `rest` is whether segments that stand out are begun at rest too.
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
    return working, chained(working, judged, rest, _CREEPS) if np.isfinite(judged.chi2) else judged


def is_close(working: Shooting, judged: Fit, exact: Fit | Engine, carried: bool = False) -> bool:
    """Whether a corrected form stays close to the precise one.

    Args:
        working: the likelihood by the form.
        judged: its fit.
        exact: that of the precise form, which must be no better; or the precise form itself. That must agree then, but
            for what initial states absorb, by the same from other initial states, and near the noise explain as much
            where the fit has ended: a correction for a joint that sticks and slips may hold for the point alone at
            which it was taken.
        carried: whether other initial states are known to do no harm.
    """
    slack = same(working, judged.chi2)
    if isinstance(exact, Fit):
        return judged.chi2 < exact.chi2 + slack
    if unabsorbed(working, judged) >= bar(working, judged):
        return False
    precise = dataclasses.replace(working, engine=exact, offset=None)
    if not carried and drift(working, precise, judged) > _STEADY * max(float(working.dof), _ROUGHLY * judged.chi2):
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
    return float(np.abs(beside(fit.design, offset)).max())


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
    return float((beside(fit.design, white) ** 2).sum())


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


def just(working: Shooting, precise: Shooting, nominal: Fit, bare: Fit, judged: Fit) -> tuple[Shooting, Fit, Fit]:
    """The likelihood, and fits of the nominal and of a set, by a form that does justice to the nominal too.

    Where something touches, a correction that was made for the set is wrong at the instants at which the nominal
    touches: the nominal left 1.17 of the noise for 0.86 so, and a stop was named that explained the difference.

    Args:
        working: the likelihood by a form, corrected by the precise one behind the set.
        precise: that by the precise form.
        nominal: a fit of the nominal, whose states the precise form does not need to move.
        bare: the nominal's fit by the form.
        judged: the set's.
    """
    if working.engine is precise.engine:
        return working, bare, judged
    most = float((precise.residuals(precise.predicted(nominal)) ** 2).sum())
    if not np.isfinite(most) or bare.chi2 < most + same(precise, most):
        return working, bare, judged
    first, other = (precise.fit([(fit.effects, fit.values)], fit.starts, near=fit)[0] for fit in (nominal, judged))
    sound = np.isfinite(first.chi2) and np.isfinite(other.chi2)
    return (precise, first, other) if sound else (working, bare, judged)
