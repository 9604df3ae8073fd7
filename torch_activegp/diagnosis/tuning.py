"""A nominal that was tuned on these recordings: what is missing hides behind wrong values of what was tuned."""

from __future__ import annotations

from collections.abc import Sequence

from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.proposals import Set, join, with_values
from torch_activegp.diagnosis.screening import Atom, Screen

_MOST = 4
_MORE = 20.0
_HELPED = 1.05
_NEARLY = 0.9
_HIDDEN = 0.75
_MANY = 3


def beside(screened: Screen, price: float, alone: float, together: float) -> list[list[Atom]]:
    """Effects together with those tunable ones that pay beside them, best first; none where that helps little.

    What a modeller has tuned (damping, rotor, gain, bias) gains little alone, and what is missing gains little alone
    too: it hides behind their wrong values, and shows only when they are free.

    Args:
        screened: score test on top of the nominal.
        price: what a parameter must gain.
        alone: what the best effect alone is worth; a tuning must help more.
        together: what the best effects in any company are worth; a tuning must be worth nearly as much.
    """
    tunable = [atom for atom in screened.best() if atom.effect.tunable]
    found = [(screened.joint_gain([a, *tunable]), a) for a in screened.atoms if not a.effect.tunable]
    chosen: list[tuple[float, list[Atom]]] = []
    seen: dict[tuple[str, str], int] = {}
    for _, atom in sorted(found, key=lambda item: -item[0]):
        seen[atom.effect.key] = seen.get(atom.effect.key, 0) + 1
        if seen[atom.effect.key] <= 2 and len(chosen) < _MOST:
            some = [atom, *paying(screened, [atom], tunable, price)]
            gain, values = screened.together(some)
            chosen.append((gain - price * sum(map(len, values)), with_values(some, values)))
    worth = max((worth for worth, _ in chosen), default=0.0)
    if worth < max(alone + _MORE, _HELPED * alone, _NEARLY * together):
        return []
    return [some for _, some in sorted(chosen, key=lambda item: -item[0])]


def undone(fit: Fit, screened: Screen, price: float) -> list[Set]:
    """A fit with all further tunable effects that pay together.

    Args:
        fit: a set that holds more than tunable effects.
        screened: score test on top of it.
        price: what a parameter must gain.
    """
    near = paying(screened, [], [a for a in screened.best() if a.effect.tunable], price)
    return [join(fit, near)] if near else []


def paying(screened: Screen, held: Sequence[Atom], tunable: Sequence[Atom], price: float) -> list[Atom]:
    """Those tunable effects without which the rest loses more than their price, to first order."""
    near = list(tunable)
    while near:
        without = [screened.joint_gain([*held, *(b for b in near if b is not a)]) if held or len(near) > 1 else 0.0
                   for a in near]  # fmt: skip
        loss = screened.joint_gain([*held, *near]) - max(without)
        if loss >= price:
            break
        del near[without.index(max(without))]
    return near


def only_undoes(nominal: Fit, alone: Fit, without: Fit, best: Fit) -> bool:
    """Whether tunable effects do no more than undo a tuning.

    A tuning hides what is missing, and the missing hides the tuning: it gains less alone than beside the rest. Errors
    that have nothing to do with each other gain the same, and such as stand in for each other gain more alone. So many
    errors at once beside something missing, as a tuning makes, are not there by chance.

    Args:
        nominal: the fit without effects.
        alone: with the tunable effects alone.
        without: with the others alone.
        best: with all of them.
    """
    hidden = nominal.chi2 - alone.chi2 < _HIDDEN * (without.chi2 - best.chi2)
    return hidden or len(alone.effects) >= _MANY
