"""First names of what strikes, in time steps short enough for it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.preparation.telling import CREEPS
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.development import expand
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect

_WORK = 4e6
"""Time steps for the search on a part of the data, and as many for what it ends with on all."""


def in_short_steps(
    numerics: Numerics,
    engine: Engine,
    shooting: Shooting,
    part: Shooting,
    found: Selection,
    effects: Sequence[Effect],
    tell: Callable[[str], None],
) -> tuple[Engine, Shooting, Fit, Fit] | None:
    """A stop or a play that explains more, in short time steps, than all that was found in long ones.

    Sets are compared by the cheapest form that does what the nominal does, and what strikes does something else in its
    steps: when in one it strikes is an accident. A play of 0.12 mm in a ball screw, recorded to 0.01 mm, left six times
    the noise in steps of 4 ms, three times what three other names left, and 1.00 in steps of 0.5 ms. What was found is
    fitted in the short steps too, so that what they alone gain is nobody's.

    Args:
        numerics: the forms of the model.
        engine: the precise form.
        shooting: the likelihood on all data.
        part: the likelihood on a part of the data.
        found: the sets that were compared by it.
        effects: what is tried.
        tell: hears what is being done.

    Returns:
        As :meth:`Numerics.choose` does: the form in short steps, the likelihood by it on all data, the nominal's fit,
        and that of the stop or the play. None where these leave more or fail, and where there are no shorter steps.
    """
    form = (numerics.firm if numerics.sticks(engine) else numerics.finest) or numerics.fine
    striking = [effect for effect in effects if effect.strikes]
    if not striking or form.steps_in(part.segments) <= part.engine.steps_in(part.segments):
        return None
    tell("testing what strikes in shorter time steps")
    sharp, whole = (dataclasses.replace(some, engine=form, cheap=None, offset=None) for some in (part, shooting))
    end, known = sharp.work + _WORK, found.best
    bare = sharp.fit([((), ())], found.nominal.starts, CREEPS)[0]
    tried = Selection(bare, [bare], found.score)
    expand(tried, sharp, striking, bare, end)
    best = tried.best
    if not best.effects or found.score(best) >= found.score(known):
        return None
    other = sharp.fit([(known.effects, known.values)], known.starts, CREEPS)[0]
    if found.score(best) >= found.score(other):
        return None
    sets = [((), ()), (best.effects, best.values)]
    bare, judged = whole.fit(sets, form.starts(whole.segments), work=whole.work + _WORK)
    return (form, whole, bare, judged) if judged.chi2 < bare.chi2 < np.inf else None
