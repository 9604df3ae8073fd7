"""Effects that act more than once in one place, such as cogging in several waves."""

from __future__ import annotations

from torch_activegp.diagnosis.selection.proposals import Worth
from torch_activegp.diagnosis.selection.screening import Atom, Screen
from torch_activegp.diagnosis.shooting.fit import Fit


def repeated(fit: Fit, screened: Screen, worth: Worth, least: float) -> list[tuple[Atom, ...]]:
    """One effect at several of its seeds together, as far as each is worth more than those before, to first order.

    One wave fitted alone moves to where it stands in for the others a little, and hides them.

    Args:
        fit: what may hold the effect already.
        screened: score test on top of it.
        worth: of a set, less its price.
        least: what once more must add to the worth.
    """
    found = []
    for effect in dict.fromkeys(atom.effect for atom in screened.atoms if atom.effect.more is not None):
        atoms = [atom for atom in screened.atoms if atom.effect is effect]
        company: tuple[Atom, ...] = (max(atoms, key=lambda atom: atom.gain),)
        held = next((form for form in fit.effects if form.key == effect.key), None)
        room = len(effect.family()) if held is None else len(held.family()) - 1
        for _ in range(room - 1):
            larger = max(((*company, atom) for atom in atoms if atom not in company), key=worth, default=company)
            if worth(larger) <= worth(company) + least:
                break
            company = larger
            found.append(company)
    return found
