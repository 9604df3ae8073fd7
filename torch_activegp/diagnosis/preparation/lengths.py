"""How long segments are: so long that the nominal stays close enough for a linearisation to mean something."""

from __future__ import annotations

import bisect
import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Array, median_step
from torch_activegp.diagnosis.inputs.segments import Segments, cut, halve
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.brief_pieces import begun, brief
from torch_activegp.diagnosis.preparation.unsure_controls import behind_gaps, unsure
from torch_activegp.diagnosis.shooting.chaining import chained, passed
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.point import total
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.forms import Forms

SECONDS = 1.0
ROWS = 45
"""A segment holds at least so many rows: what is sampled slowly is watched longer."""
PAD = 0.1
_SHORTEST, _SHORTEST_TOUCHING = 0.25, 0.1
"""Of segments, s; the second where something touches, if `halve` leaves them rows enough. A sphere on a floor bounces
another time where the initial state is a little off: in segments of 0.25 s three of 34 were left at 30 to 180 times the
noise by any name."""
_GROWTH = 6.0
_OUT, _OUT_FAR = 10.0, 0.25
"""A segment stands out by so many times the median, and by so large a part of what is too far: one of twenty whose
initial state was not found, at 50 times the noise, made a search of 150 s where nothing was missing."""
_USUAL, _MOST, _ELSEWHERE = 1.5, 2.0, 1 / 3
"""Times the median, which may be so many times the noise, that is noise; and where a segment is cut whose halves are no
more. On a drive (EMPS) whose nominal is off by 1e6 times the noise, most halves left less than 1.5 times the median."""
_ROUNDS = 6
_FAR_BEHIND, _AGAIN = 400.0, 20
"""Chi2 of a sample by which names may be off in a segment, and rounds of a fit to longer ones."""


@dataclasses.dataclass(frozen=True, eq=False)
class Lengths:
    """Segments, and how well the nominal follows them.

    Args:
        segments: S segments.
        nominal: its fit to them, roughly.
        uncut: the same to segments of which none was halved.
        form: the cheap form of the model by which it follows these better.
    """

    segments: Segments
    nominal: Fit
    uncut: Fit
    form: Engine

    @property
    def halved(self) -> bool:
        """Whether some of the segments were halved."""
        return self.segments.size > len(self.uncut.starts)


def longest(machine: Machine, forms: Forms, noise: NoiseModel, too_far: float, known: Lengths | None = None) -> Lengths:
    """The longest segments over which the nominal stays close enough.

    A segment is halved where the nominal is too far from it, where it stands out from the others, or where a small
    error of the initial state grows much; and where controls that are not quite known matter, at a gap if there is one.
    Where both halves of one that stands out are noise, it is cut elsewhere: what struck the machine just where it was
    cut is made up for by the initial state of the second half. Both strikes of a slide on a stop went so, and nothing
    was left of a mismatch. A piece may be half of the shortest there. Not where the model itself strikes something.

    Args:
        machine: model and runs.
        forms: of the model.
        noise: of the recordings.
        too_far: chi2 per degree of freedom.
        known: what another bar gave, with the same noise.
    """
    if known is None:
        shooting, whole = followed(machine, forms, noise)
        segments, form = shooting.segments, shooting.engine
    else:
        segments, whole, form = uncut(machine), known.uncut, known.form
    best = whole
    shortest = _SHORTEST_TOUCHING if forms.stiff else _SHORTEST
    while True:
        out = _stands_out(best, segments, too_far)
        guessed = unsure(Shooting(form, segments, noise), best)
        bad = out | guessed | (_growth(best, segments, noise, machine.model.nq) > _GROWTH)
        long = segments.dt[:, 0] * np.diff(segments.scored, axis=1)[:, 0] > 1.5 * shortest
        middle = np.where(guessed, behind_gaps(segments), 0.5)
        shorter = halve(segments, bad & long, middle)
        if shorter.size == segments.size:
            return Lengths(segments, best, whole, form)
        fit = _with_new(Shooting(form, shorter, noise), forms.stiff, segments, best)
        hidden = out & long & ~_loud(fit, shorter, segments)
        if hidden.any() and not forms.stiff:
            elsewhere = halve(segments, bad & long, np.where(hidden, _ELSEWHERE, middle))
            if elsewhere.size == shorter.size:  # no piece would be too short
                shorter, fit = elsewhere, _with_new(Shooting(form, elsewhere, noise), forms.stiff, segments, best)
        best, segments = fit, shorter


def followed(machine: Machine, forms: Forms, noise: NoiseModel) -> tuple[Shooting, Fit]:
    """The likelihood over segments of which none was halved, by the cheap form that follows them better; and its fit.

    Args:
        machine: model and runs.
        forms: of the model.
        noise: of the recordings.
    """
    cheap = [forms.coarse, *([forms.late] if forms.late is not None else [])]
    segments = uncut(machine)
    found = [(one, _roughly(one, forms.stiff)) for one in (Shooting(form, segments, noise) for form in cheap)]
    shooting, fit = min(found, key=lambda pair: pair[1].chi2)
    return shooting, chained(shooting, fit)


def followed_by(shooting: Shooting, known: Shooting, best: Fit) -> tuple[Shooting, Fit] | None:
    """The likelihood over segments that a set of effects follows, of which those are halved that it does not; its fit.

    Args:
        shooting: the likelihood over segments of which none was halved.
        known: that over other segments.
        best: the set's fit to these.

    Returns:
        None where a simulation fails.
    """
    while True:
        segments = shooting.segments
        fit = shooting.fit([(best.effects, best.values)], passed(known, best, segments), _AGAIN)[0]
        fit = chained(shooting, fit, rounds=_AGAIN) if np.isfinite(fit.chi2) else fit
        if fit.design is None or not np.isfinite(fit.chi2):
            return None
        grows = _growth(fit, segments, shooting.noise, shooting.engine.model.nq) > _GROWTH
        bad = segments.far_off(fit.per_segment, _FAR_BEHIND) | grows
        long = segments.dt[:, 0] * np.diff(segments.scored, axis=1)[:, 0] > 1.5 * _SHORTEST
        shorter = halve(segments, bad & long)
        if shorter.size == segments.size:
            return shooting, fit
        shooting = dataclasses.replace(shooting, segments=shorter)


def nominal_in_brief(machine: Machine, forms: Forms, noise: NoiseModel) -> Lengths | None:
    """How well the nominal follows brief pieces of the runs; None where rows are too far apart for any."""
    segments = brief(machine.fit)
    if segments is None:
        return None
    shooting = Shooting(forms.coarse, segments, noise)
    fit = chained(shooting, _roughly(shooting))
    return Lengths(segments, fit, fit, forms.coarse)


def _stands_out(fit: Fit, segments: Segments, too_far: float) -> NDArray[np.bool_]:
    """Where a fit is too far off, or much farther than elsewhere, ``(S,)``."""
    usual = _OUT * float(np.median(fit.per_segment / segments.samples))
    return segments.far_off(fit.per_segment, min(too_far, max(usual, _OUT_FAR * too_far)))


def _loud(fit: Fit, pieces: Segments, whole: Segments) -> NDArray[np.bool_]:
    """Whether a fit leaves more than noise in some piece of each segment, ``(S,)``."""
    level = fit.per_segment / pieces.samples
    begins = [list(zip(some.run, some.scored[:, 0], strict=True)) for some in (whole, pieces)]
    of = np.array([bisect.bisect_right(begins[0], begin) - 1 for begin in begins[1]])
    most = np.zeros(whole.size)
    np.maximum.at(most, of, level)
    return most > _USUAL * float(np.clip(np.median(level), 1.0, _MOST))


def uncut(machine: Machine, times: int = 1) -> Segments:
    """The segments before any is halved, or some so many times as long."""
    return cut(machine.fit, times * max(SECONDS, ROWS * median_step(machine.fit)), PAD)


def _roughly(shooting: Shooting, touches: bool = False) -> Fit:
    """The model without effects, which begins where brief pieces lead if something touches."""
    starts = begun(shooting) if touches else shooting.engine.starts(shooting.segments)
    return shooting.fit([((), ())], starts, _ROUNDS)[0]


def _with_new(shooting: Shooting, touches: bool, known: Segments, fit: Fit) -> Fit:
    """The same over segments of which some are known, where it stays as it is."""
    places = {place: number for number, place in enumerate(_places(known))}
    there = np.array([places.get(place, -1) for place in _places(shooting.segments)])
    new, rows = there < 0, shooting.segments.position[0].size
    found = _roughly(shooting.pick(new), touches)
    assert fit.design is not None
    assert found.design is not None
    there[new] = len(fit.starts) + np.arange(new.sum())
    pairs = (fit.starts, found.starts), (fit.per_segment, found.per_segment), (fit.design[:, :rows], found.design)
    starts, per_segment, design = (np.concatenate(pair)[there] for pair in pairs)
    whole = Fit((), (), starts, total(per_segment), per_segment, found.information, starts[:, :0], design)
    return chained(shooting, whole)


def _places(segments: Segments) -> list[tuple[int, ...]]:
    """Run, first row and scored rows of each segment."""
    return [tuple(place) for place in np.column_stack([segments.run, segments.first, segments.scored]).tolist()]


def _growth(fit: Fit, segments: Segments, noise: NoiseModel, nq: int) -> Array:
    """How much an error of one of nq initial positions grows within each segment, ``(S,)``."""
    assert fit.design is not None
    size, channels = segments.size, len(noise.scale)
    moved = fit.design.reshape(size, -1, channels, fit.design.shape[-1])[..., :nq]
    return np.asarray(np.abs(moved * noise.innovation[:, None]).max(axis=(1, 2, 3)))
