"""First names of what strikes, in time steps short enough for it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.preparation.telling import CREEPS
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.development import expand
from torch_activegp.diagnosis.selection.proposals import Set
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect

_WORK = 4e6
"""Time steps for the search."""


def in_short_steps(
    numerics: Numerics,
    engine: Engine,
    part: Shooting,
    found: Selection,
    effects: Sequence[Effect],
    tell: Callable[[str], None],
    in_vain: bool = False,
) -> Set | None:
    """A stop or a play that explains more, in short time steps, than all that was found in long ones.

    Sets are compared by the cheapest form that does what the nominal does, and what strikes does something else in its
    steps: when in one it strikes is an accident. A play of 0.12 mm in a ball screw, recorded to 0.01 mm, left six times
    the noise in steps of 4 ms, three times what three other names left, and 1.00 in steps of 0.5 ms. One of 0.7 mrad
    behind two other effects left 35000 in steps of 5 ms, where a wrong gain beside them left 7100, and 4750 in a fourth
    of these. What was found is fitted in the short steps too, so that what they alone gain is nobody's; and what they
    alone lose is no play's to make good: a scara arm left 1.146 times the noise in long steps of the form that was
    close, with a play 1.146 too in short ones of another, and 1.33 in these without.

    Args:
        numerics: the forms of the model.
        engine: the precise form.
        part: the likelihood on a part of the data.
        found: the sets that were compared by it.
        effects: what is tried.
        tell: hears what is being done.
        in_vain: whether what was found leaves much and leads nowhere; else a play alone is tried, on top of the best
            set.

    Returns:
        The set with the stop or the play, and its parameters. None where it leaves more or fails, and where there are
        no shorter steps.
    """
    sticks = numerics.sticks(engine)
    quick, precise = (numerics.firm_quick, numerics.firm) if sticks else (numerics.quick, numerics.finest)
    form = (precise if in_vain else quick or precise) or numerics.fine
    striking = [effect for effect in effects if effect.strikes and (in_vain or effect.needs_past)]
    if not striking or form.substeps <= part.engine.substeps:
        return None
    tell("testing what strikes in shorter time steps")
    sharp = dataclasses.replace(part, engine=form, cheap=None, offset=None)
    end, known = sharp.work + _WORK, found.best
    bare = sharp.fit([((), ())], found.nominal.starts, CREEPS)[0]
    tried = Selection(bare, [bare], found.score)
    begin = bare if in_vain else _again(sharp, known)
    if not in_vain:
        tried.add([begin])
    expand(tried, sharp, striking, begin, end)
    best = tried.best
    if best is begin or not best.effects or not found.score(best) < found.score(known):
        return None
    other = _again(sharp, known) if in_vain else begin
    return (best.effects, best.values) if found.score(best) < found.score(other) else None


def _again(sharp: Shooting, known: Fit) -> Fit:
    """What was found, in the short steps."""
    return sharp.fit([(known.effects, known.values)], known.starts, CREEPS)[0]
