"""The evidence: the named effects against every rival explanation."""

from __future__ import annotations

from typing import Any

from torch_activegp.report.numbers import is_number, misfit, number, percent
from torch_activegp.report.section import Section, Values
from torch_activegp.report.words import bic_word, capital, effect_text, effects_text, listed

_FIRST = 8
_HARDLY = 1e-12
_CLOSE, _ROUNDING = 2.0, 1e-6
_LONG = 2
"""A set of more effects than these that contains the best one is told by what it adds."""
_DEARER, _NEEDLESS = "fits as well, costs more", "more than is needed"
"""Of sets that leave no more than the best one, and of those that hold it and something else."""
_TIE, _SAME = 6.0, "not told apart here"
"""Of ties that score farther apart than others do: one law in two places, or a machine that strikes something."""
_TAGS = {"none": "the verdict", "named": "the verdict", "tie": "tied", "unknown": "not enough"}


def rivals(diagnosis: Values, evidence: Values) -> Section | None:
    """The explanations side by side, best first; None if none were compared."""
    found = diagnosis.get("rivals") or []
    if not found:
        return None
    along = diagnosis.get("retuned") or []
    named = _key([*(diagnosis.get("effects") or []), *along])
    rows = [_row(rival, found[0], named) | _told(rival["effects"], found[0]["effects"], along) for rival in found]
    for row, rival in zip(rows, found, strict=True):
        if diagnosis["verdict"] == "unknown":  # of sets of which none is enough, none is probable
            row |= {"probability": percent(None), "width": 0.0}
        stands_in = _stands_in(rival, found[0], diagnosis)
        if row["named"] or stands_in or (diagnosis["verdict"] == "tie" and row["close"]):
            row["tag"] = _TAGS[diagnosis["verdict"]]
        elif _fits_as_well(rival, found[0]) and (_gap(rival, found[0]) or 0.0) > _TIE:
            row["word"] = _DEARER
        elif _holds(rival, found[0]):
            row["word"] = _NEEDLESS
        if stands_in and (_gap(rival, found[0]) or 0.0) > _TIE:
            row["word"] = _SAME
    content = {"rows": rows[:_FIRST], "more": rows[_FIRST:]}
    return Section("rivals", "Evidence", _heading(diagnosis, found, named), content)


def _heading(diagnosis: Values, found: list[Values], named: frozenset[Any]) -> str:
    if diagnosis["verdict"] == "tie":
        return "Several explanations fit these recordings equally well"
    if diagnosis["verdict"] == "unknown":
        return "The best known explanation is not good enough"
    others = [rival for rival in found if _key(rival["effects"]) != named]
    others = [r for r in others if not (_fits_as_well(r, found[0]) or _holds(r, found[0]))] or others
    gap = _gap(others[0], found[0]) if others and _key(found[0]["effects"]) == named else None
    if gap is None:
        return "The explanations compared"
    if diagnosis["verdict"] == "none":
        return f"No effect improves on the simulator: the best is {number(gap, 2)} points worse"
    return f"{capital(effects_text(diagnosis['effects']))}: the next rival is {number(gap, 2)} points worse"


def _fits_as_well(rival: Values, best: Values) -> bool:
    """Whether another explanation leaves no more: what it is behind is the price of its names."""
    here, there = rival.get("chi2_per_dof"), best.get("chi2_per_dof")
    return rival is not best and is_number(here) and is_number(there) and here <= there * (1.0 + _ROUNDING)


def _holds(rival: Values, best: Values) -> bool:
    """Whether another explanation has all effects of the best one, where that has any, and something else."""
    return bool(best["effects"]) and _key(rival["effects"]) > _key(best["effects"])


def _row(rival: Values, best: Values, named: frozenset[Any]) -> dict[str, Any]:
    gap, probability = _gap(rival, best), rival.get("probability")
    return {
        "named": _key(rival["effects"]) == named,
        "chi2": misfit(rival.get("chi2_per_dof")),
        "gap": number(gap, 3) if gap else "best" if gap == 0 else number(None),
        "close": gap is not None and gap < _CLOSE,
        "tag": "",
        "word": bic_word(gap) if gap else "",
        "probability": percent(probability or _HARDLY if is_number(probability) else None),
        "width": round(100 * min(1.0, max(0.0, probability)), 1) if is_number(probability) else 0.0,
    }


def _told(effects: list[Values], best: list[Values], along: list[Values]) -> dict[str, str]:
    """What a set is called, and apart from it what it shares of all that is fitted along: what differs stands out."""
    keys = _key(effects)
    if best and len(effects) > _LONG and keys > _key(best):
        return {"name": capital(listed(["the same", *map(effect_text, _outside(effects, best))])), "along": ""}
    own, missing = _outside(effects, along), _outside(along, effects)
    shared = _outside(along, missing)
    if not own or not shared:
        return {"name": capital(effects_text(effects)), "along": ""}
    if len(shared) <= max(_LONG, len(missing)):
        return {"name": capital(effects_text(own)), "along": f"with {effects_text(shared)}"}
    without = f", without {effects_text(missing)}" if missing else ""
    return {"name": capital(effects_text(own)), "along": f"with {len(shared)} fitted along{without}"}


def _outside(effects: list[Values], others: list[Values]) -> list[Values]:
    keys = _key(others)
    return [effect for effect in effects if not _key([effect]) <= keys]


def _stands_in(rival: Values, best: Values, diagnosis: Values) -> bool:
    """Whether a set is the best one with ties in place of some names: one law by another name, whatever names cost."""
    keys, effects = _key(rival["effects"]), diagnosis.get("effects") or []
    ties = [_key(effect.get("ties") or []) for effect in effects]
    tied = frozenset().union(*ties)
    each = all(keys & (_key([effect]) | own) for effect, own in zip(effects, ties, strict=True))
    return bool(each and keys & tied and keys - tied <= _key(best["effects"]))


def _gap(rival: Values, best: Values) -> float | None:
    """Points between two; none where they differ by rounding alone."""
    here, there = rival.get("delta_bic"), best.get("delta_bic")
    if not (is_number(here) and is_number(there)):
        return None
    return gap if (gap := abs(here - there)) > _ROUNDING else 0.0


def _key(effects: list[Values]) -> frozenset[Any]:
    return frozenset((effect["name"], effect.get("target")) for effect in effects)
