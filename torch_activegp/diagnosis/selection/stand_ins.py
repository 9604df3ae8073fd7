"""What could stand in place of what a search found, or behind it: rivals, soft friction, a tuned nominal."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.selection.compared import Effort, Selection, compare, without_each
from torch_activegp.diagnosis.selection.elsewhere import elsewhere
from torch_activegp.diagnosis.selection.heats import CLOSE, PART, heat, near
from torch_activegp.diagnosis.selection.proposals import (
    Set,
    contains,
    diverse,
    join,
    other_forms,
    softened,
    with_values,
)
from torch_activegp.diagnosis.selection.screening import Atom, Screen, allowed, screen
from torch_activegp.diagnosis.selection.tuning import at_an_optimum, undone
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.bristles import BRISTLES
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.soft_friction import SOFT

RIVALS, MOST_RIVALS = 4, 8
"""Others that are tried in place of an effect, and where they gain as much as it does, to first order."""
AS_MUCH = 0.99
"""So much is as much: of an encoder's offset behind a gap and a gain, four others gained 0.01 % more, and a centre of
mass was named without it."""
ALIKE = 0.6
"""To stand in for an effect, another one must gain so much of what it gains, to first order."""
_AS_GOOD = 0.9
"""And so much for its other forms to be tried: a bucket's centre of mass lay off along two axes, and one of them alone
gained less than an offset of the encoder, which nearly did what both do."""
_MOST_OF_IT = 0.5
"""Of what a set explains: a part of it that does so is worth a look in its other forms."""
_SECOND, _ADDS, _ADDS_PART = 40, 40.0, 0.01
"""Effects that are looked at beside one that may stand in; and chi2 that each of the two must add to the other, or part
of what the effect gains: of 8 pairs that were no pairs one added nothing."""
_PLENTY = 400.0
_LOST, _ROUNDS = 10.0, 20
"""Chi2 per degree of freedom by which a set is lost without an effect, and rounds of the fit that shows it."""
_PROMISING = 0.2
"""Part of the chi2 that dry friction must gain to first order for its soft form to be tried."""


def swap(selection: Selection, shooting: Shooting, effects: Sequence[Effect], work: float = np.inf) -> None:
    """Tries other effects in place of each effect of the best set: rivals, and the way out of a false start.

    Fits end where so many time steps are computed in all: where joints strike, those of three sets took 20 million.
    """
    best = selection.best
    named = [effect for effect in best.effects if effect.key not in selection.score.free]
    lost = _lost_on_a_part(selection, shooting, named)
    smaller = without_each(selection, shooting, [effect for effect in named if effect not in lost], work)
    if selection.best is not best or not (smaller or lost):  # another set comes first now
        return
    least_loss = min((fit.chi2 - best.chi2 for _, fit in smaller), default=np.inf)
    seen = [(effect, *_seen(shooting, fit, fit.chi2 - best.chi2)) for effect, fit in smaller]
    found = [elsewhere(best, effects)]
    found += [_in_place(best, *one, effects) for one in (*seen, *((effect, *there) for effect, there in lost.items()))]
    known, sets, starts = {frozenset(fit.effects) for fit in selection.fits}, list[Set](), None
    for rivals in found:
        sets += (
            new := [some for some in without_needless_bristles(rivals, selection) if frozenset(some[0]) not in known]
        )
        known |= {frozenset(some) for some, _ in new}
    part, which = _enough(shooting, least_loss)
    if sets and part.segments.size < shooting.segments.size:
        sets, starts = near(part, which, sets, best, [CLOSE * selection.score.scale] * len(sets), work)
    below = [selection.below(some) for some, _ in sets]
    compare(shooting, selection, sets, best, Effort(work=work, race=True), starts=starts, below=below)


def without_needless_bristles(sets: Sequence[Set], selection: Selection) -> list[Set]:
    """Some sets, those whose friction has bristles that the best one's has not at the end, and where they may tell.

    That is where more than noise is left, or where they spare a name: they want short steps, and take long. Where the
    work ends soon what is simpler must not wait for them.
    """
    best, refines = selection.best, selection.score.refines

    def are_new(some: Set) -> bool:
        return any(effect.variant == BRISTLES and effect not in best.effects for effect in some[0])

    kept = [some for some in sets if not (are_new(some) and refines) or len(some[0]) < len(best.effects)]
    return sorted(kept, key=are_new)


def _in_place(best: Fit, effect: Effect, part: Shooting, fit: Fit, effects: Sequence[Effect]) -> list[Set]:
    """The best set with others in place of one of its effects.

    What gains as much begins a second time with the rest as it is in the best set. Where the rest made up for what was
    gone, it led nowhere: of a push, a spring and a Stribeck friction, a bias in place of the push left 1.021 of the
    noise on a part for 0.995.

    Args:
        best: the best set.
        effect: of it.
        part: the likelihood, over a part of the data perhaps.
        fit: the best set without the effect there.
        effects: what is tried.
    """
    screened = screen(part, fit, allowed(effects, fit))
    own = max((a.gain for a in screened.atoms if a.effect.key == effect.key), default=0.0)
    atoms = [a for a in screened.best() if a.gain >= ALIKE * own and not _same_or_more(a.effect, effect)]
    found: list[Set] = []
    first = diverse(atoms, RIVALS)
    alike = [atom for atom in diverse(atoms, MOST_RIVALS)[len(first) :] if atom.gain > AS_MUCH * own]
    for atom in [*first, *alike]:
        rival = join(fit, [atom])
        found.append(rival)
        if atom.gain > _AS_GOOD * own:
            pairs = list(zip(*rival, strict=True))
            found.append((rival[0], tuple(best.by_effect.get(e, v) for e, v in pairs)))
            found += other_forms(pairs, effects, atom.effect)
    return [*found, *_by_two(fit, screened, atoms, effect, own)]


def _by_two(fit: Fit, screened: Screen, atoms: Sequence[Atom], effect: Effect, own: float) -> list[Set]:
    """The two that together gain most in place of one effect, where that is about as much as the effect gains.

    One name with two numbers may stand for two: a spring with a rest stood for gravity that differed, and for what
    friction of two levels does beside one. Neither in its place came near, nor any on top. Each must add to what the
    other does.

    Args:
        fit: the set without the effect.
        screened: score test on top of it.
        atoms: what may stand in its place.
        effect: of the best set.
        own: what it gains, to first order.
    """
    first = [atom for atom in diverse(atoms, RIVALS) if atom.effect.key != effect.key]
    second = [atom for atom in screened.best()[:_SECOND] if atom.effect.key != effect.key]
    pairs: list[tuple[float, list[Atom]]] = []
    for a, b in itertools.product(first, second):
        if a.effect.key != b.effect.key and not contains(a.effect, b.effect) and not contains(b.effect, a.effect):
            gain = screened.joint_gain([a, b])
            if gain > max(a.gain, b.gain) + max(_ADDS, _ADDS_PART * own):
                pairs.append((gain, [a, b]))
    gain, pair = max(pairs, key=lambda item: item[0], default=(0.0, []))
    return [join(fit, with_values(pair, screened.together(pair)[1]))] if gain > _AS_GOOD * own else []


def _lost_on_a_part(
    selection: Selection, shooting: Shooting, named: Sequence[Effect]
) -> dict[Effect, tuple[Shooting, Fit]]:
    """Effects without which a part of the data is lost already, with that part, and the fit of the others to it.

    On all data such a fit, far from anything, would take longest: on a lift, 97 s for two of three effects.
    """
    best = selection.best
    rests = {effect: tuple(e for e in best.effects if e is not effect) for effect in named}
    unknown = [effect for effect, rest in rests.items() if rest and selection.of(rest) is None]
    part, which = shooting.subset(PART)
    if not unknown or part.segments.size == shooting.segments.size:
        return {}
    here = best.pick(which)
    lost = zip(unknown, _smaller(part, here, [rests[effect] for effect in unknown]), strict=True)
    return {e: (part, fit) for e, fit in lost if np.isfinite(fit.chi2) and fit.chi2 - here.chi2 > _LOST * part.dof}


def _smaller(part: Shooting, here: Fit, sets: Sequence[Sequence[Effect]]) -> list[Fit]:
    """Fits of some sets that a fit holds, from where it is on a part of the data, and not to their ends."""
    return part.fit([here.part(some) for some in sets], here.starts, _ROUNDS, near=here)


def _seen(shooting: Shooting, fit: Fit, gain: float) -> tuple[Shooting, Fit]:
    """A part of the data on which an effect still gains much, and a fit there."""
    part, which = _enough(shooting, gain)
    return part, fit.pick(which)


def _enough(shooting: Shooting, gain: float) -> tuple[Shooting, NDArray[np.int64]]:
    """A part of the data on which an effect still gains much, and its segments."""
    return shooting.subset(max(_PLENTY / max(gain, 1.0), PART))


def _same_or_more(effect: Effect, than: Effect) -> bool:
    """Whether an effect is another one or contains it: it was tried on top already."""
    return effect is than or contains(effect, than)


def soften(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> bool:
    """Fits soft forms of dry friction on top of the best set and of the nominal; returns whether there were any.

    Firm friction on a light joint lets go and catches within a few rows; no fit of it finds the way from far off.
    """
    firm = [effect for effect in effects if any(form.key == effect.key and form.variant == SOFT for form in effects)]
    tried = False
    for fit in {id(fit): fit for fit in (selection.best, selection.nominal)}.values():
        atoms = screen(shooting, fit, allowed(firm, fit)).best()
        sets = softened([join(fit, [atom]) for atom in atoms if atom.gain > _PROMISING * fit.chi2], effects)
        if fresh := [some for some in sets if selection.of(some[0]) is None]:
            compare(shooting, selection, fresh, fit)
            tried = True
    return tried


def try_tuned(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> None:
    """Fits each name of the best set beside all that is tunable, where the nominal seems to be tuned.

    A name that is not tunable may stand for several that are: a payload, for a gain, a damping and a rotor at once.
    """
    best, nominal, score = selection.best, selection.nominal, selection.score
    tunable = [effect for effect in effects if effect.tunable]
    named = [effect for effect in best.effects if not effect.tunable]
    if not tunable or len(named) < 2:
        return
    if not score.free and not at_an_optimum(screen(shooting, nominal, tunable), nominal.chi2 - best.chi2):
        return
    rests = [*([e for e in named if e is not one] for one in named), *([one] for one in named if len(named) > 2)]
    part, which = shooting.subset(PART)  # on all data fits without a name, far from anything, take longest
    share = part.segments.size / shooting.segments.size
    bare = _smaller(part, best.pick(which), rests)
    sets = [some for fit in bare for some in _undone(selection, part, fit, tunable, share)]
    lenient = dataclasses.replace(score, free=frozenset(effect.key for effect in tunable))
    passed = heat(shooting, sets, best, lenient)
    compare(shooting, selection, passed.sets, best, Effort(race=True), starts=passed.starts)


def undo(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> None:
    """Fits the best set with all further tunable effects that pay beside it: a tuning moves more than one or two."""
    best, tunable = selection.best, [effect for effect in effects if effect.tunable]
    compare(shooting, selection, _undone(selection, shooting, best, tunable), best, below=best)


def _undone(
    selection: Selection, shooting: Shooting, fit: Fit, tunable: Sequence[Effect], share: float = 1.0
) -> list[Set]:
    """A set with all further tunable effects that pay beside it on a share of the data, where it was not compared."""
    price = share * selection.score.a_parameter * selection.score.scale
    sets = undone(fit, screen(shooting, fit, allowed(tunable, fit)), price)
    return [some for some in sets if selection.of(some[0]) is None]


def forms_of_parts(selection: Selection, effects: Sequence[Effect], known: Collection[frozenset[Effect]]) -> list[Set]:
    """Other forms of what explains most of what the best set does: names that came after may stand for another axis.

    From where the part was fitted, for beside them it moved: loads of 2.4 and -2.4 kg stood for a centre of mass that
    was off along a second axis too, and the first one was a third of what it is. And, where much more than noise is
    left, of the one name that leaves least, if it remembers: in a leg's knee a gap left less than any other, and with
    the joint's damping on the motor a fifth of that, while a delay and four more took its place.
    """
    best, nominal = selection.best, selection.nominal
    much = nominal.chi2 - _MOST_OF_IT * (nominal.chi2 - best.chi2)
    some = [fit for fit in selection.fits if fit.effects and fit.chi2 < much]
    parts = [fit for fit in some if set(fit.effects) < set(best.effects)]
    if selection.score.inadequate:
        first = min((fit for fit in some if len(fit.effects) == 1), key=lambda fit: fit.chi2, default=None)
        parts += [first] if first is not None and first.effects[0].needs_past else []
    found = {
        frozenset(some[0]): some
        for fit in sorted(parts, key=lambda fit: -fit.chi2)
        for some in other_forms(list(zip(fit.effects, fit.values, strict=True)), effects)
    }
    return [some for key, some in found.items() if key not in known]
