"""What a user should know of how the effects were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from torch_activegp.diagnosis.findings.doubts import MUCH_LEFT
from torch_activegp.diagnosis.inputs.held_out import SEEN
from torch_activegp.diagnosis.inputs.not_recorded import unrecorded
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.process_left import by_positions
from torch_activegp.diagnosis.selection.search import Depth
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.backlash import Backlash
from torch_activegp.physics.effect import Effect

_MOST = 0.75
"""Share of the recordings below which it is said: ends of runs and first rows of segments never count."""
_TO_AND_FRO = {"hysteresis": "hysteresis", "asymmetric_friction": "friction that differs between the directions"}
_AFTER_UNKNOWN = (
    "Where to look now, in this order: signs and units of each column{slips}; rows that hold the command that led to "
    "them (`rows_late = 1` in a column map), or samples of a smooth one (`hold_order = 3`); limits of controls "
    "(ctrlrange) that the drive does not have; joints, controls or loads that moved or changed and were not recorded; "
    "then physics that is not on the list, for which the map says where and when (docs/diagnosis.md, After `unknown`)."
)
_SLIPS = ", for those of controls, and slips of ten such as cm for mm, are not always recognised"
_QUIET, _FAR_OFF = 2.0, 10.0
"""Times the noise that names leave where it is fitted and that held-out runs are forecast with, from which on it is
said. Right names had up to 11, on what sticks."""
_WORK_ENDED = f"when it had computed {Depth().work / 1e6:g} million time steps"
_IN_VAIN = "because all that could be found on a part of the data left much more than noise"


def search_notes(explanation: Explanation, corrected: Sequence[Effect]) -> list[str]:
    """What to know of the part of the data that was used, of a search that was cut short, and of what was not sought.

    Args:
        explanation: what was found, and how.
        corrected: the effects that the correction holds, none where nothing is named.
    """
    return [
        *_part_note(explanation.shooting.segments),
        *_cut_short_note(explanation.selection),
        *_hidden_notes(corrected),
        *_process_notes(explanation, corrected),
        *_step_notes(explanation.selection, corrected),
        *_one_way_notes(explanation.effects),
    ]


def outcome_notes(
    explanation: Explanation, verdict: str, left: float, holdout: Mapping[str, Any], model: mujoco.MjModel
) -> list[str]:
    """Where to look after `unknown`, or what to doubt of the forecasts of any other verdict.

    Args:
        explanation: what was found, and how.
        verdict: of it.
        left: chi2 per degree of freedom.
        holdout: the errors on held-out runs.
        model: as it was given.
    """
    if verdict == "unknown":
        return unknown_notes(explanation)
    return forecast_notes(left, holdout, explanation.shooting, model)


def unknown_notes(explanation: Explanation) -> list[str]:
    """Where to look after `unknown`; where no effect comes near, at units first.

    A carriage's positions in cm, read in mm, left 2430 times the noise.
    """
    left = explanation.selection.best.chi2 / explanation.shooting.dof
    far = left >= MUCH_LEFT
    all_of_it = f"All that was tried leaves {left:.3g} times the noise (chi2 per dof). " if far else ""
    return [all_of_it + _AFTER_UNKNOWN.format(slips=_SLIPS if far else "")]


def forecast_notes(
    chi2_per_dof: float, holdout: Mapping[str, Any], shooting: Shooting, model: mujoco.MjModel
) -> list[str]:
    """What to doubt where noise is left, and much more in held-out runs.

    On a leg that squats, in pieces of 0.12 s, a push and a friction of the knee left what a load of the trunk and a
    damping did; held-out runs were forecast with 26 times the noise. Without the recording of an exoskeleton's knee
    nothing was missing in pieces of half a second, and forecasts were off by 39 times the noise.

    Args:
        chi2_per_dof: what is left of the fitted runs.
        holdout: the errors on held-out runs.
        shooting: the likelihood.
        model: as it was given.
    """
    step = holdout["one_step"]
    ratio = step["after"] / max(step["noise"], 1e-300)
    if chi2_per_dof > _QUIET or ratio < _FAR_OFF:
        return []
    far = f"One step ahead held-out runs are forecast with {ratio:.2g} times the noise"
    if hidden := unrecorded(model, shooting.engine.channels):
        return [
            f"{far}: positions of {' and '.join(hidden)} are not recorded, and {SEEN:g} s of the others, which each "
            "forecast begins from, hardly show them. Record them, or judge by the free runs."
        ]
    return [
        f"{far}, though {chi2_per_dof:.2g} times the noise (chi2 per dof) is left in the pieces of "
        f"{shooting.segments.usual_seconds:.2g} s that were fitted. What such pieces hardly show may be missing, or a "
        "name may stand for another that does the same there."
    ]


def _cut_short_note(selection: Selection) -> list[str]:
    """That not all was tried, and why."""
    if not selection.cut_short:
        return []
    return [
        f"The search for effects ended early, {_IN_VAIN if selection.in_vain else _WORK_ENDED}. Further ones on top of "
        "those found, or others in their place, were not all tried."
    ]


def _hidden_notes(corrected: Sequence[Effect]) -> list[str]:
    """Joints whose recordings turned out to be of their motors."""
    return [
        f"{effect.target}: the recordings agree with an encoder on the motor, in front of the gap. States of this "
        "joint in the corrected simulator are the motor's, as recorded."
        for effect in corrected
        if isinstance(effect, Backlash) and effect.on_motor
    ]


def _process_notes(explanation: Explanation, corrected: Sequence[Effect]) -> list[str]:
    """Joints on which what the names leave was weighed as a random acceleration."""
    shooting, selection = explanation.shooting, explanation.selection
    if shooting.noise.process is None:
        return []
    known = next((fit for fit in selection.ranked() if set(fit.effects) == set(corrected)), selection.nominal)
    alone, fit = by_positions(shooting, known)
    channels = shooting.engine.channels
    return [
        f"joint:{joint}: what any effects leave is more than the noise of its positions, though next to nothing of the "
        f"mismatch. It is weighed as process noise, a random acceleration of {density:.2g} {unit}/s2/sqrt(Hz), and "
        "counts as noise in all that is said here. By the noise of positions alone the model that is given here leaves "
        f"{fit.chi2 / alone.dof:.3g} times the noise (chi2 per dof) in pieces of {alone.segments.usual_seconds:.2g} s."
        for joint, unit, density in zip(channels.joints, channels.units, shooting.noise.process, strict=True)
        if density > 0.0
    ]


def _step_notes(selection: Selection, corrected: Sequence[Effect]) -> list[str]:
    """What is fitted along and not named, for it may be a matter of time steps."""
    steps = [f"{effect.name} at {effect.target}" for effect in corrected if effect in selection.of_a_step]
    if not steps:
        return []
    return [
        f"{' and '.join(steps)}: fitted along and not named, as small as an error of the time step. With forces "
        "computed at another instant of each step the recordings agree as well without. If they are of a machine, and "
        "not of a simulator, it may be there."
    ]


def _one_way_notes(effects: Sequence[Effect]) -> list[str]:
    """Joints that do not turn back, or go one way only: what is sought only on others."""
    joints = dict.fromkeys(effect.target for effect in effects if effect.target.startswith("joint:"))
    tried = {effect.key for effect in effects}
    notes = []
    for joint in joints:
        lacking = [what for what in _TO_AND_FRO if (what, joint) not in tried]
        if lacking:
            sought = " and ".join(_TO_AND_FRO[what] for what in lacking)
            notes.append(f"{joint} hardly turns back in these recordings: {sought} cannot show, and was not sought.")
    return notes


def _part_note(segments: Segments) -> list[str]:
    share = float(np.diff(segments.scored).sum()) / sum(map(len, segments.runs))
    if share > _MOST:
        return []
    return [
        f"The effects were fitted to {100 * share:.0f}% of the recordings, evenly spread: simulating them all takes "
        "long, and these tell enough. Intervals hold for this part."
    ]
