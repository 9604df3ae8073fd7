"""Names one after another, where those that came together leave more than noise."""

from __future__ import annotations

from collections.abc import Callable

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS, hopeless
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE


def one_by_one(
    selection: Selection,
    shooting: Shooting,
    develop: Callable[[Fit], None],
    may_go_on: Callable[[Fit], bool],
    least: int = 1,
) -> bool:
    """Develops the best single name, the best two of which it is one, and so on, as long as each gains.

    Far from the machine, names that help each other to first order may lead astray: of dry and viscous friction and a
    cogging, on a pendulum, a hysteresis, two frictions and a centre of mass came first and left 1.22 of the noise. What
    comes on top of a single name is seen from where that leads. Where a search began from several names that were found
    on less of the data, single ones are fitted first: a push, a load and an encoder's gain that left 1.49 stood for a
    rotor and a bias, of which the bias alone left 2.0 in brief pieces, and was not looked at again.

    Args:
        selection: where a set leaves noise alone, all leave nearly all, or it was cut short, nothing is done.
        shooting: the likelihood.
        develop: fits what is promising on top of a set, and notes that.
        may_go_on: whether to develop a set; where not, nothing comes after it.
        least: names in the best set from which on it is asked.

    Returns:
        Whether another set is the best one now.
    """
    before, found = selection.best, None
    few = selection.cut_short or selection.score.names_in(before.effects) < least
    if few or before.chi2 < NOISE_ALONE * shooting.dof or hopeless(selection, shooting):
        return False
    bare = selection.nominal
    if _next(selection, None) is None and frozenset() not in selection.developed and may_go_on(bare):
        develop(bare)
    while (found := _next(selection, found)) is not None and selection.score.names_in(found.effects) < MAX_EFFECTS:
        if frozenset(found.effects) in selection.developed:
            continue
        if not may_go_on(found):
            break
        develop(found)
    return selection.best is not before


def _next(selection: Selection, found: Fit | None) -> Fit | None:
    """The best set with one name more, if it is better."""
    score = selection.score
    here, names = (frozenset[tuple[str, str]](), 0) if found is None else (found.keys, score.names_in(found.effects))
    larger = (fit for fit in selection.ranked() if fit.keys > here and score.names_in(fit.effects) == names + 1)
    best = next(larger, None)
    return best if found is None or best is None or score(best) < score(found) else None
