"""From compared sets to a verdict: how sure, what else, what is left."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from torch_activegp.diagnosis.preparation.noise_left import recoloured, rises
from torch_activegp.diagnosis.selection.adequacy import INADEQUATE, MANY, is_crowded, leaves_much, most_left
from torch_activegp.diagnosis.selection.behind_noise import BEHIND_COLOUR, least_gain
from torch_activegp.diagnosis.selection.compared import Selection, fitted
from torch_activegp.diagnosis.selection.intervals import is_certain
from torch_activegp.diagnosis.selection.omnibus import Omnibus, omnibus
from torch_activegp.diagnosis.selection.own_limits import is_own_limit
from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS
from torch_activegp.diagnosis.selection.standing_out import comes_and_goes, stands_out
from torch_activegp.diagnosis.selection.ties import (
    Rivals,
    as_part,
    is_one_way,
    swapped,
    ties_of,
    told_apart_by,
    unnamed,
)
from torch_activegp.diagnosis.selection.tuning import is_a_tuning
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import TIE
from torch_activegp.physics.effect import Effect

LEAST_SHARE = 0.002
"""What explains less of the mismatch stays in the correction and is not named, unless it is much of what is left; never
behind a tuning, a part of which it may undo: a rod's mass, tuned 0.1 % too high, was an armature of 0.0004."""
LITTLE = 0.5
"""A set that surely leaves more of a mismatch too small to be seen explains none: right ones left 0.06 of it, and 0.39
that may be noise; a stop and a cogging that stood for a pocket of negative damping 0.71."""
VERY_STRONG = 10.0
"""Score, with what any name at all must gain taken off, by which names must be better than none: very strong evidence
(Kass & Raftery 1995, Bayes factors, section 3.2). Rounding to a coarse encoder's steps gained a cogging 2.5; right
names gained 31 at least in 800 cases, but for a weak saturation with 12.7."""
FAINTEST = 0.005
"""Part of the noise that names take away at least: no encoder is known better. The loop of a resolver, which reads some
of its acceleration, was a gap, or a gain of 1.0004, that took 0.0033; of 120 right sets none took less than 0.0097."""
NEEDED = 50.0
"""Chi2, in units of the noise that is left, that each of several names must take away. On 200 cases right ones took 75
at least beside others; a cogging behind a stop 34, and so did a push, a spring and another gravity in its place, a
damping that was 0.03 % too large 28."""
BESIDE = 0.02
"""Part of the noise that each of several names must take away, as one alone that is barely visible does. Of 70 right
ones without which the set was compared too none took less than 0.13, and of 154 by their shares one less than 0.06, of
a mismatch of 1 %; a load of 0.016 % of a table, where drag was missing, took 0.014."""
SURE = 1e-5
DOUBT, _MAYBE = 0.01, 0.1
VISIBLE = 0.3
"""A mismatch without any name must be this large a part of the noise: floors are known no better."""
VISIBLE_IN_COLOUR = 1.5
"""The same where the noise is coloured."""
VISIBLE_UNSEEN = 5.0
"""The same for recordings below 67 Hz: whether an encoder filters its noise cannot be seen there, and behind a filter
of one pole at 0.7 fourth differences show a fifth of the variance."""
VISIBLE_SOMEWHERE = 0.1
"""The same where it comes and goes, as noise does not."""
SLOW = 1 / 30
VISIBLE_WHEN_SLOW = 12.0
"""The same for recordings below 30 Hz, as from video: their differences hardly show slow errors of the recorder."""


@dataclasses.dataclass(frozen=True)
class Judgement:
    """The verdict with its reasons.

    Args:
        verdict: ``none``, ``named``, ``tie`` or ``unknown``.
        fit: the set that was chosen.
        named: the effects of it that are named, in the order in which they explain.
        shares: part of the mismatch that each explains.
        probabilities: of each.
        ties: of each, (name, target) pairs.
        retuned: effects of the set that are not named: they undo a tuning of the nominal, explain next to nothing,
            may be nothing at all, gain too little, or are a limit or a time step that the model has.
        unexplained: part of the mismatch that is left.
        white: whether what is left is noise.
        p_value: that there is no mismatch: the smaller one of two tests, of a force free in time and of the best set
            among all of as many names, times two (Bonferroni).
        rivals: compared sets, their scores less the best one's, and their probabilities. The first one is not named
            where it is hardly better than none.
    """

    verdict: str
    fit: Fit
    named: tuple[Effect, ...]
    shares: tuple[float, ...]
    probabilities: tuple[float, ...]
    ties: tuple[tuple[tuple[str, str], ...], ...]
    retuned: tuple[Effect, ...]
    unexplained: float
    white: bool
    p_value: float
    rivals: Rivals


def judge(shooting: Shooting, selection: Selection) -> Judgement:
    """Decides what may be said.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
    """
    best, nominal = selection.best, selection.nominal
    before = omnibus(shooting, nominal)
    rivals = _rivals(selection)
    gain = nominal.chi2 - best.chi2
    score = selection.score
    gained = score(nominal) - score(best)
    if not best.effects or gained < VERY_STRONG or gain < FAINTEST * shooting.dof:
        return _nameless(shooting, nominal, before, rivals)
    after = omnibus(dataclasses.replace(shooting, noise=recoloured(shooting, best)), best)
    misfit, whole = best.chi2 / shooting.dof, (best.chi2 - shooting.dof) / max(nominal.chi2 - shooting.dof, 1e-300)
    quick = misfit > 1.0 + least_visible(shooting) and leaves_much(misfit, whole)  # for a force in bins of 0.2 s to see
    unexplained = max(after.excess / max(after.excess + gain, 1e-300), whole if quick else 0.0)
    white = after.p_value > SURE and not quick
    within = told_apart_by(shooting, best)
    named, tuned = _split(shooting, selection, rivals, within)
    order, shares = _shares(shooting, selection, named, 1.0 - unexplained)
    worth = 2.0 * score.least * score.scale / max(gain, 1e-300) if score.inadequate else score.material
    least = LEAST_SHARE if tuned else min(LEAST_SHARE, worth)
    kept = [i for i, share in enumerate(shares) if share >= least] or [0]
    count, plain = len(kept), not tuned and len(kept) == len(order)
    certain = [i for i in kept if is_certain(shooting, best, [order[i]])]
    if len(certain) < 2 and not is_certain(shooting, best, [order[i] for i in kept], alone=True):
        return _nameless(shooting, nominal, before, rivals)  # other initial states gained what it seemed to
    kept = certain or kept[:1]
    model, values = shooting.engine.model, best.by_effect
    kept = [i for i in kept if _is_needed(shooting, selection, order[i])] or kept
    own = [order[i] in selection.of_a_step or is_own_limit(model, order[i], values) for i in kept]
    kept = [i for i, is_own in zip(kept, own, strict=True) if not is_own] or kept
    retuned = (*tuned, *(effect for i, effect in enumerate(order) if i not in kept))
    order, shares = tuple(order[i] for i in kept), tuple(shares[i] for i in kept)
    probabilities = tuple(_probability(rivals, effect) for effect in order)
    one_way = is_one_way(shooting)
    alike = [ties_of(rivals, best, effect, retuned, tuned, one_way, selection.tunable, within) for effect in order]
    beside = unnamed(retuned, tuned, selection.tunable)
    wider = [as_part(shooting, selection, effect, beside - {effect.key}) for effect in order]
    ties = tuple(tuple(dict.fromkeys([*one, *more])) for one, more in zip(alike, wider, strict=True))
    sets = math.comb(max(score.names, len(best.effects)), len(best.effects))
    p_value = 2.0 * min(before.p_value, float(stats.chi2.sf(gain / score.scale, best.size)) * sets)
    missing = after.excess / shooting.dof
    crowded = is_crowded(missing, count, unexplained)
    seen = _visible(shooting, best, after)
    most = most_left(misfit, missing, count, len(tuned), seen, selection.cut_short, whole)
    verdict = "tie" if any(ties) else "named"
    if (after.p_value < DOUBT or quick) and (unexplained > most or crowded):
        if (crowded and unexplained <= INADEQUATE) or quick or _visible(shooting, nominal, before):
            verdict = "unknown"
        elif crowded or not plain or count >= MANY or (unexplained > LITTLE and not white):
            return _nameless(shooting, nominal, before, rivals)
        elif gained < least_gain(shooting, best):
            return _nameless(shooting, nominal, before, rivals)
    elif after.p_value < _MAYBE and unexplained > INADEQUATE and gained < BEHIND_COLOUR:
        return _nameless(shooting, nominal, before, rivals)
    return Judgement(
        verdict, best, order, shares, probabilities, ties, retuned, unexplained, white, min(p_value, 1.0), rivals
    )


def _nameless(shooting: Shooting, fit: Fit, left: Omnibus, rivals: Rivals) -> Judgement:
    """Without a name: a mismatch that nothing explains, or none."""
    unknown = _visible(shooting, fit, left) or (left.p_value < SURE and _is_somewhere(shooting, fit, left))
    verdict, share = ("unknown", 1.0) if unknown else ("none", 0.0)
    return Judgement(verdict, fit, (), (), (), (), (), share, not unknown, left.p_value, rivals)


def _is_somewhere(shooting: Shooting, fit: Fit, left: Omnibus) -> bool:
    """Whether a mismatch is in some places alone, which noise of any level and colour is not."""
    if stands_out(shooting, fit, least_visible(shooting)):
        return True
    return left.excess > VISIBLE_SOMEWHERE * shooting.dof and comes_and_goes(shooting, fit)


def _visible(shooting: Shooting, fit: Fit, left: Omnibus) -> bool:
    """Whether a mismatch without a name is large enough to be believed."""
    if fit.chi2 > (1.0 + VISIBLE_IN_COLOUR) * shooting.dof and rises(shooting, fit):
        return True  # though quicker than a force in bins of 0.2 s
    return left.p_value < SURE and left.excess > least_visible(shooting) * shooting.dof


def least_visible(shooting: Shooting) -> float:
    """By how much chi2 per degree of freedom noise may be louder than its floor."""
    least = VISIBLE_IN_COLOUR if shooting.noise.colour.any() else VISIBLE
    if not shooting.hides_colour:
        return least
    return VISIBLE_WHEN_SLOW if float(np.median(shooting.segments.dt)) > SLOW else max(least, VISIBLE_UNSEEN)


def _rivals(selection: Selection) -> Rivals:
    ranked = selection.ranked()
    scores = np.array([selection.score(fit) for fit in ranked])
    weights = np.exp(-0.5 * (scores - scores.min()))
    weights /= weights.sum()
    return tuple((f, float(s - scores.min()), float(w)) for f, s, w in zip(ranked, scores, weights, strict=True))


def _split(
    shooting: Shooting, selection: Selection, rivals: Rivals, within: float = TIE
) -> tuple[list[Effect], tuple[Effect, ...]]:
    """Tells effects from nuisances: what a modeller had tuned on these data gains nothing alone.

    A nominal that was tuned on the data sits where damping, gain, rotor and bias, or what cannot be told from them,
    gain nothing by themselves; only together with what is missing do they move back. Where something was tuned, a mass
    of which the model has too much was tuned too: it is no physics that was left out.
    """
    best = selection.best
    every = [e for fit in (best, *(rival for rival, _, _ in rivals)) for e in fit.effects]
    names = {e.key for e in (*every, *selection.tunable) if e.tunable}  # of another form of them too
    tunable = [e for e in best.effects if e.key in names or names & set(swapped(rivals, best, e, within))]
    others = [e for e in best.effects if e not in tunable]
    if not tunable or not others:
        return list(best.effects), ()
    if not is_a_tuning(shooting, selection, tunable, others, selection.needs_more_than(MAX_EFFECTS)):
        return list(best.effects), ()
    heavy = [e for e in others if "mass" in e.losses and e.too_much(best.by_effect[e])]
    named = [e for e in others if e not in heavy] or others
    return named, tuple(e for e in best.effects if e not in named)


def _shares(
    shooting: Shooting, selection: Selection, named: Sequence[Effect], explained: float
) -> tuple[tuple[Effect, ...], tuple[float, ...]]:
    """Order of the effects by what each adds to those before it, and the parts."""
    best, nominal = selection.best, selection.nominal
    total = max(nominal.chi2 - best.chi2, 1e-300)
    always = [e for e in best.effects if e not in named]
    order: list[Effect] = []
    level, shares = nominal.chi2, []
    while len(order) < len(named):
        left = [e for e in named if e not in order]
        if len(left) == 1:
            fits = [best]
        else:
            fits = [fitted(shooting, selection, [*always, *order, e]) for e in left]
        first = min(range(len(left)), key=lambda i: fits[i].chi2)
        order.append(left[first])
        shares.append(float(np.clip((level - fits[first].chi2) / total, 0.0, 1.0)) * explained)
        level = min(level, fits[first].chi2)
    return tuple(order), tuple(shares)


def _is_needed(shooting: Shooting, selection: Selection, effect: Effect) -> bool:
    """Whether the best set leaves far less than without one of its effects, where that was fitted."""
    best = selection.best
    rest = selection.of([other for other in best.effects if other is not effect])
    return rest is None or rest.chi2 - best.chi2 >= max(NEEDED * selection.score.scale, BESIDE * shooting.dof)


def _probability(rivals: Rivals, effect: Effect) -> float:
    return float(min(sum(weight for fit, _, weight in rivals if effect.key in fit.keys), 1.0))
