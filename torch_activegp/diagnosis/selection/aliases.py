"""Names that do the same to the recordings as one of a set: told by columns, without a search."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.heats import CLOSE, PART
from torch_activegp.diagnosis.selection.proposals import Set, diverse, paired
from torch_activegp.diagnosis.selection.screening import Atom, allowed, atoms_of, without
from torch_activegp.diagnosis.selection.sensitivities import effect_columns, parameter_columns, remembered, unit_values
from torch_activegp.diagnosis.selection.stand_ins import AS_MUCH
from torch_activegp.diagnosis.shooting.elimination import project
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import linearize
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE, TIE
from torch_activegp.physics.effect import Effect

_MOST = 4
"""Aliases of one effect that are fitted."""
_HALF = 0.5
"""What does less of it is none, however little there is."""
_ROUNDS, _TIMES, _WORK = 20, 2, 5e6
"""Simulations of a fit, one after the other; how often; and time steps for all of them each time."""


def try_aliases(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> None:
    """Fits others in place of each name of the best set that do the same there, to first order.

    For a search that was cut short, where nothing stood in place of what it found yet: a slide whose drive was stronger
    than it was told to be, damped, was 1.4 kg lighter, and no tie said so. Once more where one of them is best then.
    """
    for _ in range(_TIMES):
        best = selection.best
        if not best.effects or best.chi2 > NOISE_ALONE * shooting.dof:
            return
        near = best.chi2 + CLOSE * selection.score.scale  # others were given up, perhaps
        known = {frozenset(fit.effects) for fit in selection.fits if fit.chi2 < near}
        sets = [some for some in _in_place(selection, shooting, effects) if frozenset(some[0]) not in known]
        # in no race: what the others have to make up for comes after two steps
        selection.add(shooting.fit(sets, best.starts, _ROUNDS, near=best, work=shooting.work + _WORK))
        selection.rescale(shooting.dof)
        if selection.best is best:
            return


def _in_place(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> list[Set]:
    """The best set with an alias in place of each of its names."""
    best, found = selection.best, dict[frozenset[Effect], Set]()
    for effect in (e for e in best.effects if e.key not in selection.score.free):
        rest = [(e, v) for e, v in best.by_effect.items() if e is not effect]
        for atom in diverse(aliases(shooting, best, effect, effects, TIE * selection.score.scale), _MOST):
            some = paired([*rest, (atom.effect, atom.values)])
            found.setdefault(frozenset(some[0]), some)
    return list(found.values())


def aliases(shooting: Shooting, fit: Fit, effect: Effect, effects: Sequence[Effect], slack: float = 0.0) -> list[Atom]:
    """What could take the place of one effect of a fit, each at its best seed, the most alike first.

    What it does there is a combination of columns; another one is an alias if it makes up 99 % of that beside initial
    states and the other fitted parameters, or all but what does not tell sets apart: of a slide's gain, 185 in chi2
    beside a lag, a load made up all but 5. Of a limit, which has no amplitude, nothing is told.

    Args:
        shooting: the likelihood; a part of its segments is enough.
        fit: a set.
        effect: of it.
        effects: what is tried.
        slack: chi2 on all data by which sets that are not told apart may differ.
    """
    if not effect.linear and effect.parameters[0].place:
        return []
    part, which = shooting.subset(PART)
    here, (others, kept) = fit.pick(which), fit.part(e for e in fit.effects if e is not effect)
    rest = dataclasses.replace(fit, effects=others, values=kept)
    free = [e for e in allowed(effects, rest) if e.key != effect.key and effect.name not in e.covers]
    plan = [(e, seed) for e in free for seed in e.seeds]
    wanted = [(e, values) for e, seed in plan for values in unit_values(e, seed)]
    linear = linearize(part, here)
    held, tested = parameter_columns(part, here), effect_columns(part, here, wanted, linear, remembered(wanted, part))
    blocks = linear.respond_to_start(), np.concatenate([held, tested], axis=-1)
    start, columns = (part.whiten_columns(block) for block in blocks)
    normal, _ = project(start, columns, np.zeros_like(part.residual_of(here)))
    own = np.arange(fit.size)[fit.places[effect]]
    order = [*(i for i in range(fit.size) if i not in own), *own.tolist(), *range(fit.size, len(normal))]
    normal, _ = without(fit.size - len(own), normal[np.ix_(order, order)], np.zeros(len(normal)))
    mine, theirs, amount = slice(0, len(own)), slice(len(own), None), _steps(effect, fit.by_effect[effect])
    pull, whole = normal[theirs, mine] @ amount, float(amount @ normal[mine, mine] @ amount)
    least = float(np.clip(whole - slack * part.dof / shooting.dof, _HALF * whole, AS_MUCH * whole))
    atoms = atoms_of(plan, normal[theirs, theirs], pull)
    found = sorted((a for a in atoms if a.gain > least > 0.0 and _inside(a)), key=lambda atom: atom.gain)
    best = {atom.effect: atom for atom in found}  # the last, the best one, of each
    return sorted(best.values(), key=lambda atom: -atom.gain)


def _steps(effect: Effect, values: Array) -> Array:
    """What an effect is, in steps of its parameters: amplitudes, or the one size that it has."""
    steps = np.array([p.step(float(value)) for p, value in zip(effect.parameters, values, strict=True)])
    amplitudes = np.arange(len(values)) < max(effect.linear, 1)
    return np.where(amplitudes, values / steps, 0.0)


def _inside(atom: Atom) -> bool:
    """Whether it does so within the bounds of its amplitudes: what hardly shows would need any."""
    amplitudes = zip(atom.effect.parameters[: max(atom.effect.linear, 1)], atom.values, strict=False)
    return all(p.low < value < p.high for p, value in amplitudes)
