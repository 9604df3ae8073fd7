"""What naming on all data begins from, and begins from again by another noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.late import Sets
from torch_activegp.diagnosis.preparation.lengths import longest
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.preparation.telling import CREEPS
from torch_activegp.diagnosis.selection.first_names import besides
from torch_activegp.diagnosis.selection.search import Depth
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine

TOO_FAR = 400.0
"""Segments are shortened for the names until the nominal's chi2 is below so much per degree of freedom."""
_LIKE = 1.5
"""Numerics are not chosen again for noise that differs by less than this factor, at any frequency."""
WHOLE, _ONCE_MORE = Depth(), Depth(work=10e6, more=5e6)
"""The second where a search is done again, by another noise or other numerics, from what was found."""
NO_FURTHER, _IN_VAIN = Depth(rounds=0, work=2e6, more=0.0), Depth(swaps=0, work=3e6, stepwise=False, more=2e6)
"""Where a long search on a part left much more than noise, what is missing is hardly on the list: its best set is
fitted to all data, for what it leaves. Where that shows another noise, a little is searched by it."""

Tell = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class Start:
    """What naming on all data begins from: numerics, likelihood, fits of the nominal and of a set, more sets.

    And the noise by which the numerics were chosen, which may be an earlier one than the likelihood's; and how deep to
    search.
    """

    engine: Engine
    shooting: Shooting
    nominal: Fit
    sets: Sets
    first: Fit
    free: frozenset[tuple[str, str]]
    noise: NoiseModel
    depth: Depth = WHOLE


def with_noise(
    machine: Machine,
    numerics: Numerics,
    start: Start,
    best: Fit,
    rest: Sets,
    free: frozenset[tuple[str, str]],
    noise: NoiseModel,
    tell: Tell,
) -> Start:
    """What naming begins from where what is left shows that the noise is another one.

    Numerics are judged by it too, unless it is much like the one that they were chosen by, behind a set that holds this
    one; from where the best set was fitted, for a stop that begins elsewhere may end anywhere, by any form. Segments
    are shortened where neither the nominal nor the best set is near enough by that noise. Beside an acceleration those
    that the nominal wants may be longer again: on EMPS all recordings count then, not 72 % of them.
    """
    tell("naming with the noise seen behind the effects")
    depth = _IN_VAIN if start.depth == NO_FURTHER else start.depth
    segments, nominal = start.shooting.segments, start.nominal
    sets: Sets = [*([(best.effects, best.values)] if best.effects else []), *rest]
    loud = float((start.shooting.noise.innovation / noise.innovation).max())
    shaken = noise.process is not None
    left = nominal.per_segment if shaken else np.minimum(nominal.per_segment, best.per_segment)
    far = bool(segments.far_off(left * loud**2, TOO_FAR).any())
    near, nominal = best.without_derivatives, nominal.without_derivatives  # which are those of the other noise
    known = bool(sets and np.isfinite(start.first.chi2)) and set(sets[0][0]) <= set(start.first.effects)
    if not far and known and _alike(noise, start.noise):
        shooting = dataclasses.replace(start.shooting, noise=noise)
        bare = shooting.fit([((), ())], nominal.starts, CREEPS, near=nominal)[0]
        judged = shooting.fit(sets[:1], near.starts, near=near)[0]
        return Start(start.engine, shooting, bare, besides(sets, judged), judged, free, start.noise, depth)
    if far:
        longer = longest(machine, numerics, noise, TOO_FAR)
        segments, nominal = longer.segments, longer.nominal
        near = nominal
    engine, shooting, nominal, judged = numerics.choose(segments, noise, near, nominal, sets)
    return Start(engine, shooting, nominal, besides(sets, judged), judged, free, noise, depth)


def once_more(depth: Depth) -> Depth:
    """How deep to search again from what was found by a search of some depth."""
    return _ONCE_MORE if depth == WHOLE else depth


def _alike(one: NoiseModel, other: NoiseModel) -> bool:
    """Whether two noises are about as loud in all channels, in what is new and in what is slow, and none shakes one."""
    if one.process is not None or other.process is not None:
        return False
    fast, slow = np.log(one.innovation / other.innovation), np.log(one.slow / other.slow)
    return bool(max(np.abs(fast).max(), np.abs(slow).max()) < np.log(_LIKE))
