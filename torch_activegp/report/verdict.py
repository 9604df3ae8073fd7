"""The verdict: one sentence, how sure it is, and the figures that carry it."""

from __future__ import annotations

import re
from typing import Any

from torch_activegp.errors import DataError
from torch_activegp.report.numbers import is_number, misfit, number, p_value, percent
from torch_activegp.report.section import Values
from torch_activegp.report.words import belief, counted, explained, telling

_RARE = 0.01
"""Part of all repeats below which what is left is not called what noise leaves: of 9 controls by another integrator
five were at 1e-20 and below, and all but one of the others at 0.09 and above."""
_LOUD = 1.5
"""Times the noise from which on more than a little is left, as in the sentence."""
_SENTENCES = re.compile(r"(?<=[a-z)]\.) (?=[A-Z])")
"""Between two sentences: the first is the heading."""
BADGES = {
    "none": ("No mismatch found", "\u2713"),
    "named": ("Mismatch named", "\u25cf"),
    "tie": ("Mismatch found, names tied", "\u25d0"),
    "unknown": ("Mismatch found, not explained", "?"),
}


def banner(diagnosis: Values) -> dict[str, Any]:
    """What the top of the page shows.

    Raises:
        DataError: the verdict is none of the four.
    """
    verdict = diagnosis.get("verdict")
    if verdict not in BADGES:
        raise DataError(
            f"diagnosis['verdict']: wanted one of {', '.join(BADGES)}, found {verdict!r}. Run diagnose again."
        )
    badge, symbol = BADGES[verdict]
    sentence, *more = _SENTENCES.split(diagnosis.get("sentence") or "", maxsplit=1)
    return {
        "verdict": verdict,
        "sentence": sentence,
        "more": " ".join(more),
        "badge": badge,
        "symbol": symbol,
        "sure": _sure(diagnosis),
        "figures": [figure for figure in (_misfit(diagnosis), _explained(diagnosis), *_forecasts(diagnosis)) if figure],
        "subject": _subject(diagnosis),
    }


def _sure(diagnosis: Values) -> str:
    mismatch, effects = diagnosis.get("mismatch") or {}, diagnosis.get("effects") or []
    chance = mismatch.get("p_value")
    if diagnosis["verdict"] == "none" and is_number(chance) and chance < _RARE:
        left = (diagnosis.get("unexplained") or {}).get("chi2_per_dof")
        if is_number(left) and left >= _LOUD:
            return f"More is left than the rows show of noise ({p_value(chance)}): so slow a noise, or physics."
        return (
            f"A little more is left than white noise would leave ({p_value(chance)}), as of another integrator or a "
            "noise that is not quite white: too little to name."
        )
    if diagnosis["verdict"] == "none":
        return (
            f"Noise alone leaves at least this much in {percent(chance)} of all repeats." if is_number(chance) else ""
        )
    real = f"The mismatch is real ({p_value(chance)} for chance)" if is_number(chance) else "The mismatch is real"
    if diagnosis["verdict"] == "unknown":
        return f"{real}, but the effects that we know do not make it up: abstaining is the honest answer."
    if diagnosis["verdict"] == "tie":
        return f"{real}; which of the tied effects causes it, these recordings do not tell."
    known = [effect["probability"] for effect in effects if is_number(effect.get("probability"))]
    if not known:
        return f"{real}."
    least = min(known)
    which = "for the least sure effect, " if len(effects) > 1 else ""
    return f"{belief(least)}: {which}{percent(least)} probability against every rival tried. {real}."


def _misfit(diagnosis: Values) -> dict[str, str] | None:
    chi2 = (diagnosis.get("mismatch") or {}).get("chi2_per_dof")
    if not is_number(chi2):
        return None
    return {"value": misfit(chi2), "label": "misfit of the simulator", "note": "chi\u00b2/dof; 1 is noise alone"}


def _explained(diagnosis: Values) -> dict[str, str] | None:
    effects = diagnosis.get("effects") or []
    if not effects:
        return None
    rest = (diagnosis.get("unexplained") or {}).get("share")
    note = f"{percent(rest)} is left" if is_number(rest) else f"by {counted(len(effects), 'effect')}"
    return {"value": percent(explained(effects)), "label": "of the mismatch explained", "note": note}


def _forecasts(diagnosis: Values) -> list[dict[str, str]]:
    holdout = ((diagnosis.get("fit") or {}).get("holdout")) or {}
    found = []
    kinds = {"free_run": "free-run error, held-out runs", "one_step": "one-step error, held-out runs"}
    for key in dict.fromkeys((telling(holdout), *kinds)):
        error = holdout.get(key) or {}
        before, after = error.get("before"), error.get("after")
        if not is_number(before):
            continue
        learned, named = error.get("gp"), bool(is_number(after) and diagnosis.get("effects"))
        steps = [before, *([after] if named else []), *([learned] if is_number(learned) else [])]
        value = " \u2192 ".join(map(percent, steps))
        last = "; the last with a learned force" if is_number(learned) else ""
        note = f"of the signal's spread{last}; noise {percent(error.get('noise'))}"
        found.append({"value": value, "label": kinds[key], "note": note})
    return found[:1]


def _subject(diagnosis: Values) -> str:
    recordings = diagnosis.get("recordings") or []
    name = (diagnosis.get("model") or {}).get("name")
    parts = [f"Simulator {name}"] if name else []
    for role, what in (("fit", "fitted"), ("holdout", "held out")):
        runs = [recording for recording in recordings if recording.get("role") == role]
        if runs:
            seconds = sum(run.get("seconds") or 0.0 for run in runs)
            parts.append(f"{counted(len(runs), 'run')} {what} ({number(seconds)} s)")
    return " \u00b7 ".join(parts)
