"""Names that explain little of a large mismatch."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.judge import DOUBT, SURE
from torch_activegp.diagnosis.selection.omnibus import Omnibus, omnibus
from torch_activegp.diagnosis.selection.search import Depth, search
from torch_activegp.diagnosis.shooting.chaining import chained
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import MATERIAL, NOISE_ALONE
from torch_activegp.physics.effect import Effect

_MATERIAL, _OF_THE_NOISE, _SURELY = 0.001, 0.02, 150.0
"""Part of the mismatch that is enough for a name here, or of the noise where that is less: behind a payload that
explained all but 0.0006 of it a dry friction was 11 times the noise, and behind a spring a drag of 0.0002 was 0.05. And
chi2 at least, of a name with one parameter: on few rows a cogging gained 65 by how a joint sticks."""
_NEAR_NOISE = 1.5
"""Times the noise: where no set comes closer to it, and more is left than a weak effect explains, none leaves noise
alone."""
_NEARLY = 0.25
"""Part of what was left that may be left behind what is weak, where even little is seen to be no noise: behind the
Stribeck part of a friction 7400 of 7900 in chi2 were gone, of a mismatch of two million, and the rest still showed; of
another one 920 of 1210."""
_DEPTH = Depth(rounds=3, swaps=1, work=10e6)


def also_weak(
    shooting: Shooting, selection: Selection, effects: Sequence[Effect], tell: Callable[[str], None] = lambda _: None
) -> Selection:
    """Sets with what is weak, where the best one leaves a little that is no noise and one of these leaves noise alone.

    Simulators differ by some thousandths of a large mismatch, so what explains no more is no name
    (:data:`~torch_activegp.diagnosis.shooting.score.MATERIAL`). But no such difference becomes noise by one more
    effect: a spring beside a payload explained 0.003 of the mismatch, which was 1200 in chi2, and left nothing but
    noise. Nor by a law with more parameters: Stribeck friction in place of Coulomb's explained as much, which was 235.
    Nor by as many other names: a spring and a push, for a tilt and a push elsewhere, left 912 less of 757 thousand.

    Not behind a rotor whose place no recording holds: what that leaves, a tenth of the noise behind the true gap of a
    slide, is no weak effect's, and half a minute was spent on it.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
        effects: what is tried.
        tell: hears what is being done.

    Returns:
        The same selection where nothing was found; else one whose best set has more names, or as many others and no
        fewer parameters; or one that scores better by what is worth a name anyway.
    """
    best, score = selection.best, selection.score
    too_much = (score.scale - 1.0) * shooting.dof > MATERIAL * score.mismatch
    far = score.inadequate or (score.scale > _NEAR_NOISE and too_much)
    if not best.effects or far or score.least < score.a_parameter:
        return selection
    if selection.cut_short:
        return with_weak(shooting, selection)
    if any(effect.needs_past for effect in best.effects):
        return selection
    before = omnibus(shooting, best)
    if before.p_value > SURE:
        return selection
    tell("testing what is weak")
    _unstuck(shooting, selection)
    score, weak = selection.score, _lighter(shooting, selection)
    search(weak, shooting, effects, tell, _DEPTH.counted_from(shooting.work))
    _unstuck(shooting, weak)
    weak.cut_short = selection.cut_short  # this one looks for more than is promised
    more = weak.score.names_in(weak.best.effects) - score.names_in(best.effects)
    others = set(weak.best.effects) != set(best.effects) and weak.best.size >= best.size
    richer = more > 0 or (more == 0 and others)
    if richer and _leaves_noise(before, omnibus(shooting, weak.best)):
        return weak
    return _with_better(selection, weak.fits, shooting.dof)


def with_weak(shooting: Shooting, selection: Selection) -> Selection:
    """The same sets with what is weak, where one of them leaves noise alone so, and much more is left without it.

    A load of four times a gripper explained all but 0.002 of a mismatch of 8700 times the noise, and left 18 times the
    noise; with a damping that noise alone was left. What the load left was taken for a random force.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
    """
    best, quiet = selection.best, NOISE_ALONE * shooting.dof
    if not best.effects or best.chi2 < _NEAR_NOISE * shooting.dof:
        return selection
    weak = _lighter(shooting, selection)
    more = selection.score.names_in(weak.best.effects) > selection.score.names_in(best.effects)
    return weak if more and weak.best.chi2 < quiet else selection


def _lighter(shooting: Shooting, selection: Selection) -> Selection:
    """The same sets, none of which was developed, compared by what is weak."""
    some = max(_OF_THE_NOISE * shooting.dof, _SURELY)
    material = min(_MATERIAL, some / selection.score.mismatch)
    score = dataclasses.replace(selection.score, material=material)
    return dataclasses.replace(selection, fits=list(selection.fits), developed=set(), score=score)


def _unstuck(shooting: Shooting, selection: Selection) -> None:
    """Begins segments of the best set anew that stand out: they look like what is weak."""
    best = selection.best
    again = chained(shooting, shooting.fit([(best.effects, best.values)], best.starts, near=best)[0])
    if again.chi2 < best.chi2:
        selection.add([again])
        selection.rescale(shooting.dof)


def _with_better(selection: Selection, fits: Sequence[Fit], dof: int) -> Selection:
    """With those of some fits that score better than its best one: nothing weak, but missed by the search before."""
    least = selection.score(selection.best)
    better = [fit for fit in fits if fit.plausible and selection.score(fit) < least]
    more = dataclasses.replace(selection, fits=[*selection.fits, *better])
    more.rescale(dof)
    return more if more.best in better else selection


def _leaves_noise(before: Omnibus, after: Omnibus) -> bool:
    """Whether what was left is noise now, or nearly all of it is gone."""
    return after.p_value > DOUBT or after.excess < _NEARLY * before.excess
