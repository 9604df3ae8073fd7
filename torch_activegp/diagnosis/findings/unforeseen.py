"""A mismatch that the held-out runs alone show: those that were fitted do not go where it acts, or hardly ever."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from torch_activegp.diagnosis.findings.rounded_clock import rounded_clock
from torch_activegp.diagnosis.findings.verdict import Verdict
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.preparation.lengths import PAD
from torch_activegp.diagnosis.preparation.telling import CREEPS
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.judge import SURE, least_visible
from torch_activegp.diagnosis.selection.omnibus import omnibus
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.point import FAILED

_FAR = {"free_run": (3.0, "the free run"), "one_step": (5.0, "a forecast by one step")}
"""Times the noise that held-out runs may be off where noise alone is left of the fitted ones, and more where that may
be louder than its floor. On 79 concealed controls free runs were off by 1.4 times at most and forecasts by one step by
1.7; beside a motor that saturated in one held-out run by 30 and 20, beside a pocket of negative damping by 341 and 31.
"""


def surprise(entries: Sequence[Mapping[str, Any]], shooting: Shooting) -> str | None:
    """Where held-out runs are far off although noise alone is left of the others; None if nowhere.

    Free runs say nothing of a run that cannot be forecast, forecasts by one step do: an arm that a stop threw back in a
    held-out run alone was off by 212 times the noise so, and left alone it fell about. Of six such runs of machines of
    which nothing was missing, they were off by 2.7 at most, but for two of a leg: see
    :func:`~torch_activegp.diagnosis.findings.reconsider.reconsider`.

    Args:
        entries: their errors, :func:`~torch_activegp.diagnosis.findings.unseen.marked`.
        shooting: the likelihood of the others.
    """
    louder = float(np.sqrt(1.0 + least_visible(shooting)))
    each = [
        (entry[kind]["before"] / (bar * louder * entry[kind]["noise"]), what, kind, entry)
        for entry in entries
        for kind, (bar, what) in _FAR.items()
        if entry.get("predictable", True) or kind == "one_step"
    ]
    if not each:
        return None
    far, what, kind, entry = max(each, key=lambda one: one[0])
    if far <= 1.0:
        return None
    error, noise = entry[kind]["before"], entry[kind]["noise"]
    motion = f"{error:.3g} of the motion of {entry['channel']}, " if noise < 1.0 else ""
    still = "" if motion else f" of {entry['channel']}, which stands still there"
    return (
        f"The simulator and the recordings that were fitted differ by noise alone, but not those held out: {what} of "
        f"{entry['run']} is off by {motion}{error / noise:.0f} times the noise{still}. What is missing acts, most "
        "likely, where the others hardly go: give this run, or more like it, to be fitted too."
    )


def seen_there(
    explanation: Explanation, verdict: Verdict, runs: Sequence[Run], why: str
) -> tuple[Explanation, Verdict] | None:
    """What the held-out runs say without any name, for where and when.

    Args:
        explanation: of the others, in which nothing is missing.
        verdict: ``none``.
        runs: the held-out ones.
        why: what :func:`surprise` says.

    Returns:
        The likelihood over the held-out runs, but for where the simulation fails, and ``unknown``; None where brief
        pieces of them show nothing: a free run that is long goes far by little. Where they show what their rounded
        clock may leave, what was said with a note on that, once.
    """
    segments = cut(runs, explanation.shooting.segments.usual_seconds, PAD)
    shooting = dataclasses.replace(explanation.shooting, engine=explanation.engine, segments=segments, offset=None)
    nominal = shooting.fit([((), ())], shooting.engine.starts(segments), CREEPS)[0]
    sound = nominal.per_segment < FAILED
    if not sound.any():
        return None
    if not sound.all():
        shooting, nominal = shooting.pick(sound), nominal.pick(sound)
    p_value = omnibus(shooting, nominal).p_value
    if p_value > SURE:
        return None
    if clock := rounded_clock(shooting, nominal):
        return None if verdict.clock else (explanation, verdict._replace(clock=clock))
    judgement = dataclasses.replace(
        verdict.judgement,
        verdict="unknown",
        fit=nominal,
        unexplained=1.0,
        white=False,
        p_value=p_value,
        rivals=((nominal, 0.0, 1.0),),
    )
    selection = Selection(nominal, [nominal], explanation.selection.score)
    there = dataclasses.replace(explanation, shooting=shooting, selection=selection)
    return there, verdict._replace(judgement=judgement, stability=None, unforeseen=why)
