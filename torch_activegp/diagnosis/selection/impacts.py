"""Sets in which something is struck: from the other side of an impact, and with what is struck elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.chaining import chained, stands_out
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.touching import strikes
from torch_activegp.physics.effect import Effect

_BEST = 4
"""So many of the best sets are looked at."""
_ROUNDS = 20


def behind_impacts(
    selection: Selection, shooting: Shooting, new: Sequence[frozenset[Effect]], work: float = float("inf")
) -> None:
    """Fits some new sets that are among the best anew, :func:`chained`, and one with what it strikes elsewhere.

    On a machine that strikes, a right rotor left 190 more than noise in one segment that began on the wrong side of an
    impact, 70 more than a wrong spring, and was never looked at again. A stop that was missing left 46 times the noise
    in a segment that began against it; and behind that 6.7 in one that turned 8 mrad before where others struck it,
    which a spring and a cogging explained.

    Args:
        selection: the compared sets; takes the new fits in.
        shooting: the likelihood by which they were compared.
        new: the sets.
        work: time steps of all that was computed by then, from which on none is fitted further.
    """
    engine = shooting.engine
    machine = strikes(engine.model, engine.channels, shooting.segments.runs)
    struck: list[Fit] = []
    for fit in selection.ranked()[:_BEST]:
        by_effects = any(effect.strikes for effect in fit.effects)
        if (machine or by_effects) and frozenset(fit.effects) in new and shooting.work < work:
            again = chained(shooting, fit)
            selection.add([] if again is fit else [again])
            struck += [again] if by_effects else []
    if struck and shooting.work < work:
        fewest = min(struck, key=lambda fit: len(fit.effects))  # what strikes elsewhere needs no more beside it
        further = struck_elsewhere(shooting, fewest)
        selection.add([] if further is fewest else [further])
    selection.rescale(shooting.dof)


def struck_elsewhere(shooting: Shooting, fit: Fit) -> Fit:
    """The fit with what it strikes further in, where that is better: for what is not struck no derivative says so.

    Args:
        shooting: the likelihood.
        fit: of any set; the same where no segment stands out, or nothing is struck.
    """
    sets = [
        (fit.effects, (*fit.values[:i], other, *fit.values[i + 1 :]))
        for i, effect in enumerate(fit.effects)
        for other in effect.further_in(fit.values[i])
    ]
    if not sets or not stands_out(shooting, fit).any():
        return fit
    ends = shooting.fit(sets, fit.starts, _ROUNDS, near=fit)
    best = min((chained(shooting, end) for end in ends), key=lambda end: end.chi2)
    return best if best.chi2 < fit.chi2 else fit
