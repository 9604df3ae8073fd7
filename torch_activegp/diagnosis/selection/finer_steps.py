"""Whether a name stands for time steps that are too long where something touches."""

from __future__ import annotations

import dataclasses
import functools

from torch_activegp.diagnosis.preparation.brief_pieces import begun
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_SMALL = 1.3
"""Times the noise that a nominal leaves at most for its time steps to be all that is missing."""


def nameless_in_finer_steps(
    numerics: Numerics, shooting: Shooting, selection: Selection
) -> tuple[Shooting, Selection] | None:
    """The nominal in shorter time steps, where it does as well as the best set does.

    Impacts end a little elsewhere in each of them. A sphere that bounced on a floor left 1.02 of the noise in steps of
    1 ms, 0.997 with a stop or a damper there, and as much in steps of 0.25 ms without. Only where that little is
    missing is it asked: shorter steps cost as much longer.

    Args:
        numerics: the forms of the model.
        shooting: the likelihood.
        selection: the compared sets.

    Returns:
        The likelihood by the shorter steps and a selection of the nominal alone; None where the names stay.
    """
    best, nominal, score = selection.best, selection.nominal, selection.score
    if not best.effects or nominal.chi2 > _SMALL * shooting.dof:
        return None
    for form in numerics.finer:
        if form.substeps <= shooting.engine.substeps:
            continue
        finer = dataclasses.replace(shooting, engine=form, offset=None)
        for starts in (lambda: nominal.starts, lambda: best.starts, functools.partial(begun, finer)):
            fit = finer.fit([((), ())], starts())[0]
            if score(fit) <= score(best):
                bare = Selection(fit, [fit], score, selection.cut_short, tunable=selection.tunable)
                bare.rescale(shooting.dof)
                return finer, bare
    return None
