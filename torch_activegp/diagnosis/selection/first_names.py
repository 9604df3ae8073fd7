"""The first names: found on a part of the data, and where the nominal is far off, in brief pieces of it before."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.late import Sets
from torch_activegp.diagnosis.preparation.lengths import nominal_in_brief
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.proposals import contains, paired
from torch_activegp.diagnosis.selection.prospects import hopeless, leaves_most
from torch_activegp.diagnosis.selection.search import Depth, go_on, select
from torch_activegp.diagnosis.selection.striking import in_short_steps
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect

FEWEST = 12
"""Segments on which first names are found: six of twenty led astray where three effects are hidden."""
_ENOUGH = 600.0
"""Chi2 above the noise by which the first names are found, on a part of the data where there is twice as much."""
_LEADS = 10.0
"""Times the noise that names found in brief pieces may leave to lead anywhere. What a machine remembers for longer, as
where in its gap a motor was, is not in them: a backlash left 68 times the noise, and what came on top led astray."""
_WORK, _MORE = 8e6, 4e6
"""Time steps for the first names: those that ended right took 7.5 million at most, where nothing strikes."""
_GLANCE = Depth(rounds=1, stepwise=False, work=_WORK, more=_MORE)
"""For names behind which numerics are chosen: under the wrong ones, names one after another are wrong too. On an arm in
steps of 5 ms they took 60 s behind a backlash, and were delays of half a step."""
_ON_A_PART = Depth(swaps=0, work=2 * _WORK, more=_MORE)
"""Swaps come with all data. Of an arm that lacked a delay, a rotor and a friction that differs by direction, the right
names came after 13 million."""
_MUCH = 1.5
"""Times the noise."""
_ODD = 1.5
"""Times what names leave on the part that they were found on, from which on all data show more than it does: of a drive
that is weaker than it was told to be, a fifth of a leg's data left 2.6 behind two other effects, and all 7.5."""

Tell = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class Naming:
    """Where naming stands.

    Args:
        engine: the precise simulation.
        shooting: the likelihood to compare sets with.
        nominal: the fit without effects.
        judged: the fit of the set behind which the numerics were chosen.
        sets: the best so far, with first guesses.
        free: what seemed to be tuned, :attr:`Score.free`.
        best: the effects of the best set.
        lost: whether what was found leaves nearly all.
        in_vain: whether a search left much more than noise: a long one, or all that there was to find left most.
        aside: sets that leave too much where they were found to lead on from, and may be the right ones yet.
    """

    engine: Engine
    shooting: Shooting
    nominal: Fit
    judged: Fit
    sets: Sets = dataclasses.field(default_factory=list)
    free: frozenset[tuple[str, str]] = frozenset()
    best: frozenset[Effect] = frozenset()
    lost: bool = False
    in_vain: bool = False
    aside: Sets = dataclasses.field(default_factory=list)

    @property
    def wants_a_part(self) -> bool:
        """Whether a part of the data is enough for the first names."""
        left = min(self.nominal.chi2, self.judged.chi2)
        much = 2 * _ENOUGH < left - self.shooting.dof < np.inf
        return bool(much) and self.shooting.segments.size > FEWEST

    def behind(self, sets: Sets, numerics: Numerics, noise: NoiseModel) -> Self:
        """The same by the form of the model that agrees best behind the first of some sets."""
        segments, nominal = self.shooting.segments, self.nominal
        engine, shooting, nominal, judged = numerics.choose(segments, noise, nominal, nominal, sets)
        return dataclasses.replace(self, engine=engine, shooting=shooting, nominal=nominal, judged=judged)

    def yet_to_try(self, judged: Fit, shooting: Shooting) -> Sets:
        """What was put aside, where all that was found since leaves as much: it may be right, and not be all.

        A motor's viscous and dry friction left 19 times the noise in brief pieces, for what else there was, and names
        found in longer ones were others; on all data they left less than these. What is part of those is tried with
        them: on a drive (EMPS) dry friction alone was developed once more, and a better third name never was. And each
        without one of its names, for nothing else may be tried then: a sensor's gain had come beside the two frictions.
        """
        if judged.chi2 <= _LEADS * shooting.dof:
            return []
        found = [some for some in self.aside if not is_part(some[0], judged)]
        return [*found, *(less for some in found for less in _one_less(some))]


def in_brief_pieces(
    machine: Machine, numerics: Numerics, noise: NoiseModel, effects: Sequence[Effect], tell: Tell
) -> Naming | None:
    """Names found in pieces so brief that the nominal cannot go far astray; None where too little is seen in them.

    Where joints stick, or with noise of a thousandth of the mismatch, a linearisation over a quarter of a second says
    nothing: on a lift with three effects a search took 200 s and led anywhere. In pieces of 60 ms the nominal is off by
    6 of the noise for 4700, and the right names come first.
    """
    first = nominal_in_brief(machine, numerics, noise)
    if first is None:
        return None
    tell("naming in brief pieces")
    naming = Naming(*numerics.choose(first.segments, noise, first.nominal, first.nominal))
    return on_a_part(naming, numerics, noise, effects, tell, _LEADS) if naming.wants_a_part else None


def on_a_part(
    naming: Naming, numerics: Numerics, noise: NoiseModel, effects: Sequence[Effect], tell: Tell, most: float = np.inf
) -> Naming:
    """Names on a part of the data; the numerics are looked at once more behind the first of them.

    Args:
        naming: with sets to begin from, if there are any.
        numerics: the forms of the model.
        noise: of the recordings.
        effects: what is tried.
        tell: hears what is being done.
        most: times the noise that the first of them may leave; else they are put aside.
    """
    part, which = _part(naming.shooting, naming.nominal)
    here = naming.nominal.pick(which)
    rough = part.fit([((), ())], here.starts, near=here)[0]
    chosen = select(part, effects, rough, naming.sets, tell=tell, free=naming.free, depth=_GLANCE)
    if chosen.score.scale > most:
        return dataclasses.replace(naming, aside=leaders(chosen)[:1])
    through = False
    if chosen.best.effects and chosen.score.scale > NOISE_ALONE:
        through = leaves_most(chosen, part)
        if through:
            chosen = go_on(chosen, part, effects, tell, _ON_A_PART.counted_from(part.work))
        else:  # behind them another form may agree better
            sets = leaders(chosen)
            naming = dataclasses.replace(naming, free=chosen.score.free).behind(sets, numerics, noise)
            part, chosen = _anew(naming, sets, chosen, effects, tell)
    lost, in_vain = _ended(chosen, part, through)
    missing = in_vain or chosen.score.scale > NOISE_ALONE
    if missing and not np.isfinite(most):  # brief pieces lend their names alone
        struck = in_short_steps(numerics, naming.engine, part, chosen, effects, tell, in_vain)
        by = None if struck is None else naming.behind([struck], numerics, noise)
        if by is not None and by.judged.chi2 < by.nominal.chi2 < np.inf:
            naming = by
            part, chosen = _anew(naming, leaders(chosen), chosen, effects, tell)
            lost, in_vain = _ended(chosen, part)
    best = frozenset(chosen.best.effects)
    return dataclasses.replace(
        naming, sets=leaders(chosen), free=chosen.score.free, best=best, lost=lost, in_vain=in_vain
    )


def _anew(
    naming: Naming, sets: Sets, chosen: Selection, effects: Sequence[Effect], tell: Tell
) -> tuple[Shooting, Selection]:
    """Names on a part of the data by another form of the model.

    Args:
        naming: where it stands, with that form.
        sets: to begin from, besides the one behind which it was taken.
        chosen: what was found by another form.
        effects: what is tried.
        tell: hears what is being done.

    Returns:
        The likelihood on the part, and what was found by it.
    """
    shooting, judged, scale = naming.shooting, naming.judged, chosen.score.scale
    odd = is_of(judged, chosen.best.effects) and judged.chi2 > _ODD * scale * shooting.dof
    part, which = _part(shooting, naming.nominal, judged.per_segment if odd else None)
    rough, there = naming.nominal.pick(which), judged.pick(which)
    seen = part.fit([(there.effects, there.values)], there.starts, near=there)[0]
    return part, select(part, effects, rough, besides(sets, seen), seen, tell, naming.free, _ON_A_PART)


def _ended(chosen: Selection, part: Shooting, through: bool = False) -> tuple[bool, bool]:
    """Whether names leave nearly all, and whether the search for them was in vain.

    Args:
        chosen: the compared sets.
        part: the likelihood on a part of the data.
        through: whether it went on by the form of the model that it began with, since the first names left most.
    """
    lost = hopeless(chosen, part)
    return lost, (chosen.cut_short or (through and lost)) and chosen.score.scale > _MUCH


def _part(shooting: Shooting, nominal: Fit, worst: Array | None = None) -> tuple[Shooting, NDArray[np.int64]]:
    """The likelihood over so much of the data as the first names want, and which segments.

    Args:
        shooting: over all S segments.
        nominal: the fit without effects.
        worst: half of the part are those with the largest of these, ``(S,)``; all are spread evenly where it is None.
    """
    excess = max(nominal.chi2 - shooting.dof, _ENOUGH)
    return shooting.subset(max(_ENOUGH / excess, 0.2, FEWEST / shooting.segments.size), worst)


def leaders(selection: Selection) -> Sets:
    """The best sets with effects: three at most, and none that more data cannot bring to the front."""
    far = selection.score(selection.best) + selection.score.slack
    near = [fit for fit in selection.ranked()[:3] if selection.score(fit) <= far]
    return [(fit.effects, fit.values) for fit in near if fit.effects]


def is_of(judged: Fit, effects: Sequence[Effect]) -> bool:
    """Whether a fit is of a set; one that failed is of none."""
    return bool(np.isfinite(judged.chi2)) and frozenset(judged.effects) == frozenset(effects)


def _one_less(some: tuple[Sequence[Effect], Sequence[Array]]) -> Sets:
    """A set without each of its names in turn; none of a single one."""
    pairs = list(zip(*some, strict=True))
    return [paired([pair for pair in pairs if pair is not one]) for one in pairs if len(pairs) > 1]


def is_part(effects: Sequence[Effect], judged: Fit) -> bool:
    """Whether a fit has each of some effects, in a form that contains the same laws, or a law that contains it."""

    def has(effect: Effect) -> bool:
        same = ((law.key, law.covers) == (effect.key, effect.covers) for law in judged.effects)
        return any(same) or any(contains(law, effect) for law in judged.effects)

    return bool(np.isfinite(judged.chi2)) and all(map(has, effects))


def besides(sets: Sets, judged: Fit) -> Sets:
    """Those of some sets that a fit is not of."""
    return [some for some in sets if not is_of(judged, some[0])]
