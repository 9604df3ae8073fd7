"""From runs to the set of effects that explains them: noise, numerics, length of segments, selection."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.engine import Engine
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.machine import Machine
from torch_activegp.diagnosis.noise_floor import noise_floor
from torch_activegp.diagnosis.noise_model import NoiseModel
from torch_activegp.diagnosis.numerics import Numerics, Sets
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.segments import Segments, cut
from torch_activegp.diagnosis.selection import Selection, select
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.physics.effect import Effect

SECONDS = 1.0
PAD = 0.1
_SHORT = 0.5
_TOO_FAR = 400.0
_ENOUGH = 1500.0


@dataclasses.dataclass(frozen=True)
class Explanation:
    """The sets that were compared, and what they were compared with.

    Args:
        engine: the precise simulation.
        shooting: the likelihood in the end.
        selection: the sets.
        effects: all that was tried.
        fine: whether the model was integrated more finely than it says.
    """

    engine: Engine
    shooting: Shooting
    selection: Selection
    effects: tuple[Effect, ...]
    fine: bool


Tell = Callable[[str], None]


def explain(machine: Machine, effects: Sequence[Effect], nthread: int = 0, tell: Tell = lambda _: None) -> Explanation:
    """Names what the model leaves out.

    Args:
        machine: model and runs.
        effects: what is tried.
        nthread: threads of the simulations; 0 for all cores.
        tell: hears what is being done.
    """
    numerics = Numerics.of(machine, nthread)
    tell("noise floor")
    noise = noise_floor(machine.fit)
    segments, first = _longest(machine, numerics, noise)
    engine, shooting, nominal, judged = numerics.choose(segments, noise, first, first)
    sets: Sets = []
    excess = nominal.chi2 - shooting.dof
    if excess > 2 * _ENOUGH and segments.size > 8:
        tell("naming on a part of the data")
        part, which = shooting.subset(max(_ENOUGH / excess, 0.2))
        rough = part.fit([((), ())], nominal.starts[which], design=_some(nominal.design, which))[0]
        sets = _leaders(select(part, effects, rough, tell=tell))
        engine, shooting, nominal, judged = numerics.choose(segments, noise, nominal, nominal, sets)
    tell("naming on all data")
    selection = select(shooting, effects, nominal, sets, judged.starts, tell)
    best, leaders = selection.best, _leaders(selection)
    if best.effects:
        again, other, bare, judged = numerics.choose(segments, noise, best, nominal, leaders, (engine, shooting))
        if again is not engine:
            engine, shooting = again, other
            tell("naming with the numerics seen behind the effects")
            seen = [(judged.effects, judged.values), *leaders]
            selection = select(shooting, effects, bare, seen, judged.starts, tell)
    return Explanation(engine, shooting, selection, tuple(effects), engine is numerics.fine)


def _leaders(selection: Selection) -> Sets:
    return [(fit.effects, fit.values) for fit in selection.ranked()[:3] if fit.effects]


def _longest(machine: Machine, numerics: Numerics, noise: NoiseModel) -> tuple[Segments, Fit]:
    """The longest segments over which the nominal stays close enough for a linearisation to mean something."""
    engine = numerics.given
    for seconds in (SECONDS, _SHORT, _SHORT / 2):
        segments = cut(machine.fit, seconds, PAD)
        shooting = Shooting(engine, segments, noise)
        nominal = shooting.fit([((), ())], engine.starts(segments), rounds=4)[0]
        if nominal.chi2 < _TOO_FAR * shooting.dof:
            break
    return segments, nominal


def _some(design: Array | None, which: NDArray[np.int64]) -> Array | None:
    return None if design is None else design[which]
