"""The best sets once more, each with the error of the cheap form taken out as it is behind that set."""

from __future__ import annotations

from torch_activegp.diagnosis.preparation.agreement import settled
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect

_MOST, _NEAR = 6, 0.02
"""Sets that are compared so, and the part of its chi2 by which they may leave more than the best one."""
_FORMS, _OTHER_FORM = 2, 0.1
"""Other forms of the best one that are, and the part that these may leave more."""
_CLOSE, _ROUNDS, _CHANGES = 30.0, 3, 1.0
"""Chi2 within which a correction is taken anew, how often, and while it changes so much. Where a joint sticks, that
changes with every fit: behind a dry friction an encoder's offset left 8.5 more than gravity that is tilted as much, and
1.2 more by a second correction."""


def by_their_own_errors(shooting: Shooting, engine: Engine, selection: Selection) -> Shooting:
    """Fits the best sets with corrections of their own, in place of that behind one of them.

    The error of a form with long steps depends little on parameters, and more on what is late: a controller's delay
    left 190 more than a sensor's, on a slide where they are one law, by steps that were corrected behind the latter.

    Args:
        shooting: the likelihood by which the sets were compared.
        engine: the precise form.
        selection: the compared sets; takes the new fits in.

    Returns:
        The likelihood with the correction behind the set that is the best one then; the same, and nothing is changed,
        where the best one does not fit as well with its own: behind an impact the states of a fit are not found again,
        and a stop that left 1.14 left 2.6, as without it.
    """
    if shooting.offset is None:
        return shooting
    most = (1.0 + _NEAR) * selection.best.chi2
    near = [fit for fit in selection.ranked() if fit.effects and fit.chi2 < most][:_MOST]
    near += _in_other_forms(selection)
    told = [(*settled(shooting, engine, fit), fit.chi2) for fit in near]
    sound = [(working, fit) for working, fit, before in told if fit.chi2 <= (1.0 + _NEAR) * before]
    known = {fit.keys for _, fit in sound}
    if selection.best.keys not in known:
        return shooting
    close = min(fit.chi2 for _, fit in sound) + _CLOSE
    sound = [_to_the_end(*one, engine) if one[1].chi2 < close else one for one in sound]
    selection.fits = [*(fit for _, fit in sound), *(fit for fit in selection.fits if fit.keys not in known)]
    selection.forget_parts()
    selection.rescale(shooting.dof)
    return next((working for working, fit in sound if fit is selection.best), shooting)


def _in_other_forms(selection: Selection) -> list[Fit]:
    """Fits of the best set's names in other forms that came near by its correction.

    Of dry friction in a joint whose own sticks firmly the soft form left as little, by steps that were corrected behind
    the firm one: by its own it left 1.17 times that, and forecast held-out runs 13 times as badly.
    """
    best, found = selection.best, dict[frozenset[Effect], Fit]()
    for fit in sorted(selection.fits, key=lambda fit: fit.chi2):
        alike = fit.keys == best.keys and fit.plausible and fit.chi2 < (1.0 + _OTHER_FORM) * best.chi2
        if alike and set(fit.effects) != set(best.effects):
            found.setdefault(frozenset(fit.effects), fit)
    return list(found.values())[:_FORMS]


def _to_the_end(working: Shooting, fit: Fit, engine: Engine) -> tuple[Shooting, Fit]:
    """A likelihood and its fit with the error taken out where that has ended, while it gets better."""
    for _ in range(_ROUNDS):
        again = settled(working, engine, fit)
        if not again[1].chi2 < fit.chi2 - _CHANGES:
            break
        working, fit = again
    return working, fit
