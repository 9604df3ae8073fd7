"""Whether what was named forecasts the held-out runs: it is no explanation of the recordings if it does not."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.findings.forecast import FAILED, rms
from torch_activegp.diagnosis.findings.verdict import Verdict
from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.inputs.segments import lay
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

LOST, NO_BETTER = 5.0, 0.25
"""Times the noise, and part of the error without names, beyond which a free run is lost. On 108 concealed cases with
names the right ones left 0.4 to 4.0 times the noise; 9.8 and 21 were left by names that stood for what is not on the
list, with 0.35 and 4 times the error without them. A real drive's are far above an encoder's noise, at 0.01 of it."""
WORSE, SEEN = 1.03, 1.2
"""Times the error without names, and the noise, beyond which forecasts of either kind got worse: those of 146 right
sets never did. A friction that grows with the load was a damping, a gain and a dead zone, with 1.19 of the error and
2.7 of the noise in free runs; a pocket of negative damping was a cogging, with 1.07 and 1.4 after one step."""
_RUN_SEEN, _RUN_AHEAD = 2.0, 1.25
"""The same beyond which the free run of one of several held-out runs got worse, where it was no farther off than the
mean of the motion: of 234 named sets one had such a run, a cogging in three waves and a centre of mass that stood for a
pocket of negative damping, with 1.19 of the error and 5 times the noise in one run, and 0.3 in the other. Another such
cogging left 7.8 times the noise where nothing had been off, and 0.18 in the other run; uncertain parameters, which
excuse so much, did not excuse that one step ahead it was off by 1.36 times the noise, for 0.93: 1.25 times the error
without names. Of 58 other named sets none had a run that was worse both ways."""
CLEARLY_LESS = 0.75
"""Part of the error without names that a free run may leave where uncertain parameters excuse it."""
_MEAN = 1.0
"""The error of the mean as a forecast, as part of the motion: names are compared with that where a simulator is farther
off without them."""
HALF = 0.5
"""Part of the error without names that a free run may leave where one step ahead shows that they are right, and of the
error beyond the noise where one step ahead is worse."""
_NUDGE, _GROWS, _BEGINS = 1e-5, 100.0, 4
"""Where so small a change of the state grows so much, from one of so many begins, no simulator forecasts the run, and
it tells nothing."""
_LONG = 0.005
"""Time steps of Runge-Kutta in which a run that is calm is believed to be, s. Changes grew as much in them to 3 %
on sixteen machines; 29 of 67 s went on them in steps of 0.25 ms, with three joints of dry friction."""


def refutation(entries: Sequence[Mapping[str, Any]], expected: Callable[[], float] = lambda: 0.0) -> str | None:
    """What the held-out runs that can be forecast say against the named effects, in words; None where nothing.

    Free runs with them are lost, or forecasts are worse with them than without, of all runs or freely of one; that
    uncertain parameters make so much excuses none whose forecasts by one step are clearly worse, too. Of a machine that
    nothing holds a free run is lost by a force of any size that is left: those of a joint say nothing where one step
    ahead it errs by less than a quarter of what it did without the names, and its free run by half: a motor with its
    friction, 0.16 of the motion away after two seconds for 0.36, was 0.09 away after 0.1 s for 0.69. Nor does one step
    ahead tell where free runs of each joint go to the noise, or half the way there, as they do of all together: behind
    a filter of the encoders it begins beside the machine. It left 1.33 times the noise for 1.21, 3.5 for 3.3 and 2.14
    for 2.02 with three right sets, whose free runs left 1.02 for 4.5, 8 for 480 and 1.14 for 1.96. The held-out runs
    choose no name and no number: they can only take names back.

    Args:
        entries: their errors, :func:`foreseeable`.
        expected: the error of free runs that the uncertainty of the parameters makes, as part of the motion; it counts
            as noise does, where names leave clearly less than there was. It is asked for where it matters.
    """
    if not entries:
        return None
    for kind, what in (("free_run", "free runs"), ("one_step", "forecasts by one step")):
        before, after, noise = _errors(entries, kind)
        far = f"not the held-out ones: {what} with them are off by {after:.3g} of the motion"
        if kind == "free_run" and _are_lost(entries, expected):
            return f"{far}, {after / noise:.0f} times the noise"
        if after > max(WORSE * before, SEEN * noise) and not (kind == "one_step" and _come_nearer(entries)):
            return f"{far}, and by {before:.3g} without"
    return _one_is_worse(entries, expected)


def _one_is_worse(entries: Sequence[Mapping[str, Any]], expected: Callable[[], float]) -> str | None:
    """The run whose moving joints are forecast worse than without the names, in words; None where none is."""
    moving = [entry for entry in entries if entry["free_run"]["noise"] < _MEAN]
    for run in dict.fromkeys(entry["run"] for entry in moving):
        own = [entry for entry in moving if entry["run"] == run]
        before, after, noise = _errors(own, "free_run")
        worse = before < _MEAN and after > max(WORSE * before, _RUN_SEEN * noise)
        if worse and (_is_worse_ahead(own) or after > _RUN_SEEN * math.hypot(noise, expected())):
            off = f"off by {after:.3g} of the motion" if after < FAILED else "lost"
            return f"not {run}: its free run with them is {off}, and off by {before:.3g} without"
    return None


def _is_worse_ahead(entries: Sequence[Mapping[str, Any]]) -> bool:
    """Whether forecasts of one run by one step are clearly worse with the names, too."""
    before, after, noise = _errors(entries, "one_step")
    return after > max(_RUN_AHEAD * before, SEEN * noise)


def _are_lost(entries: Sequence[Mapping[str, Any]], expected: Callable[[], float]) -> bool:
    """Whether free runs are far off, and neither a look one step ahead nor uncertain parameters excuse it."""
    before, after, noise = _errors(entries, "free_run")
    known = min(before, _MEAN)
    if after <= max(LOST * noise, NO_BETTER * known) or (after <= HALF * known and _see_ahead(entries)):
        return False
    return after > CLEARLY_LESS * before or after > LOST * math.hypot(noise, expected())


def _errors(entries: Sequence[Mapping[str, Any]], kind: str) -> tuple[float, float, float]:
    """Errors without names and with them, and the noise, over some entries."""
    before, after, noise = (
        rms(np.array([entry[kind][name] for entry in entries])) for name in ("before", "after", "noise")
    )
    return before, after, noise


def _come_nearer(entries: Sequence[Mapping[str, Any]]) -> bool:
    """Whether free runs of all joints go to the noise, or half the way there, and of all together the latter."""

    def halved(some: Sequence[Mapping[str, Any]]) -> bool:
        before, after, noise = _errors(some, "free_run")
        return before < FAILED and max(after**2 - noise**2, 0.0) < HALF**2 * (before**2 - noise**2)

    def quiet(some: Sequence[Mapping[str, Any]]) -> bool:
        return all(entry["free_run"]["after"] <= SEEN * entry["free_run"]["noise"] for entry in some)

    return halved(entries) and all(halved(own) or quiet(own) for own in _by_joint(entries))


def _by_joint(entries: Sequence[Mapping[str, Any]]) -> list[list[Mapping[str, Any]]]:
    joints = dict.fromkeys(entry["channel"] for entry in entries)
    return [[entry for entry in entries if entry["channel"] == joint] for joint in joints]


def _see_ahead(entries: Sequence[Mapping[str, Any]]) -> bool:
    """Whether each joint whose free runs are lost is forecast far better by one step."""
    frees = [(some, _errors(some, "free_run")) for some in _by_joint(entries)]
    lost = [some for some, (before, after, _) in frees if after > NO_BETTER * min(before, _MEAN)]
    sound = all(0.0 < entry["one_step"]["before"] < FAILED for some in lost for entry in some)
    steps = [_errors(some, "one_step") for some in lost]
    return bool(steps) and sound and all(after <= NO_BETTER * before for before, after, _ in steps)


def foreseeable(holdout: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The errors of those held-out runs that can be forecast.

    Args:
        holdout: of all, as :func:`~torch_activegp.diagnosis.findings.forecast.compare` gives them, :func:`marked`.
    """
    return [entry for entry in holdout["runs"] if entry.get("predictable", True)]


def marked(holdout: Mapping[str, Any], runs: Sequence[Run], calm: Sequence[bool]) -> tuple[dict[str, Any], list[str]]:
    """The errors of held-out runs with whether each can be forecast, and a note on those that cannot.

    Args:
        holdout: of all, as :func:`~torch_activegp.diagnosis.findings.forecast.compare` gives them.
        runs: the held-out runs, S.
        calm: of each, :func:`is_predictable`.
    """
    entries = holdout["runs"]  # as many of each run, one after the other
    each = np.repeat(np.asarray(calm), len(entries) // len(runs)).tolist()
    wild = [run.label for run, sound in zip(runs, calm, strict=True) if not sound]
    notes = [
        f"{', '.join(wild)}: by the simulator a small change of the state grows more than a hundredfold within the "
        "run, so that it cannot be forecast freely for so long. Errors of free runs say nothing there; those by one "
        "step do."
    ]
    entries = [{**entry, "predictable": sound} for entry, sound in zip(entries, each, strict=True)]
    return {**holdout, "runs": entries}, notes if wild else []


def is_predictable(
    engine: Engine, candidate: Candidate, runs: Sequence[Run], starts: Array | Sequence[Sequence[float]]
) -> NDArray[np.bool_]:
    """Whether a small change of any position or speed stays small until the end of a run, ``(S,)``.

    From its begin, and from where the machine was recorded later on: a free run that has left the recording may be
    calm. An arm that was held up by its controls hung down in one, 23000 times the noise away from the recording. Where
    one grows in long time steps, it is looked at in the engine's.
    """
    longer = engine.in_longer_steps(_LONG, median_step(runs))
    calm = _stays(longer, candidate, runs, starts)
    wild = np.flatnonzero(~calm)
    if len(wild) and longer is not engine:
        calm[wild] = _stays(engine, candidate, [runs[int(i)] for i in wild], np.asarray(starts)[wild])
    return calm


def _stays(
    engine: Engine, candidate: Candidate, runs: Sequence[Run], starts: Array | Sequence[Sequence[float]]
) -> NDArray[np.bool_]:
    """Whether small changes stay small in the time steps of an engine, ``(S,)``."""
    channels, pieces = engine.channels, []
    for number, run in enumerate(runs):
        rows = np.linspace(0, len(run) - 1, _BEGINS, endpoint=False).astype(int).tolist()
        pieces += [(number, row, row, len(run) - 1) for row in rows]
    segments = lay(runs, pieces)
    states = engine.starts(segments)
    states[::_BEGINS] = starts
    index = [*channels.qpos, *(engine.model.nq + np.asarray(channels.dof))]
    moved = np.repeat(states[None], len(index) + 1, axis=0)
    for row, column in enumerate(index):
        moved[row + 1, :, column] += _NUDGE
    paths = engine.predict(segments, moved, [candidate] * len(moved))
    change = np.nan_to_num(np.abs(paths[1:] - paths[0]), nan=np.inf).max(axis=(0, 3))
    growth = np.where(segments.counts, change, 0.0).max(axis=1) / _NUDGE
    return np.asarray((growth < _GROWS).reshape(len(runs), _BEGINS).all(axis=1))


def taken_back(verdict: Verdict, why: str) -> Verdict:
    """A verdict without its names, and with a note that says why.

    Args:
        verdict: with names.
        why: what :func:`refutation` says, or
            :func:`~torch_activegp.diagnosis.findings.doubts.reservation`.
    """
    names = " and ".join(f"{effect.name} at {effect.target}" for effect in verdict.judgement.named)
    note = f"{names} would explain these recordings best, but {why}. Nothing is named."
    judgement = dataclasses.replace(
        verdict.judgement,
        verdict="unknown",
        named=(),
        shares=(),
        probabilities=(),
        ties=(),
        retuned=(),
        unexplained=1.0,
        white=False,
    )
    return Verdict(judgement, None, (*verdict.notes, note))
