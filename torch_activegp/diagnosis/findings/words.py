"""The verdict as a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torch_activegp.diagnosis.result import NamedEffect

_MOST = 0.5
"""Part of the mismatch that the closest set may leave and be told."""
_TOLD = 3
"""So many parameters of an effect are in the sentence."""
_LOUD = 1.5
"""Chi2 per degree of freedom from which on noise is said to be louder than it looks."""
_MENDS = 0.99
"""Part of an error that a learned force may leave to be said to mend it."""
_SHOWN = 1.1
"""Times the noise from which on a forecast shows that something is missing."""
_MUCH_LEFT = 2.0
"""Chi2 per degree of freedom from which on the names are said not to be all."""


def sentence(
    verdict: str,
    effects: Sequence[NamedEffect],
    details: Mapping[str, Any],
    doubts: Sequence[str] = (),
    rounded: bool = False,
) -> str:
    """One sentence that says what was found; where nothing was, one more that says what to doubt first.

    Args:
        verdict: ``none``, ``named``, ``tie`` or ``unknown``.
        effects: the named effects.
        details: the other entries of ``diagnosis.json``.
        doubts: what seems wrong with the recordings, in sentences.
        rounded: whether the rounded clock may have left all that is more than noise.
    """
    if verdict == "none":
        return f"The simulator and the recordings differ by {_noise(details, rounded)}."
    if verdict == "unknown":
        places = [place["target"] for place in details["location"][:1]]
        where = f", most of it at {places[0]}" if places else ""
        differ = f"The simulator and the recordings differ{where}, and no effect on the list explains it"
        return f"{differ}.{_doubted(doubts)}" if doubts else f"{differ}{_closest(details)}{_learned(details)}."
    share = sum(effect.share for effect in effects)
    parts = [
        ("leaves out", [e for e in effects if not e.too_much]),
        ("has too much", [e for e in effects if e.too_much]),
    ]
    wrong = " and ".join(f"{verb} {_joined([_with_values(effect) for effect in some])}" for verb, some in parts if some)
    text = f"The simulator {wrong}, explaining {share:.0%} of the mismatch; {_better(effects, details)}"
    if verdict == "tie":
        tied = [effect for effect in effects if effect.ties]
        text = f"{text}; the recordings cannot tell {_joined([_tied(effect, len(effects) > 1) for effect in tied])}"
    return f"{text}{_rest(details)}."


def _better(effects: Sequence[NamedEffect], details: Mapping[str, Any]) -> str:
    """What names do for the forecasts of held-out runs, or that these do not show them."""
    kind, error = _measure(details)
    before, after = (f"{error[key]:.3g}" for key in ("before", "after"))
    moves = f"{'falls' if error['after'] <= error['before'] else 'rises'} from {before} to {after}"
    they, noise = "it" if len(effects) == 1 else "them", f"(noise {error['noise']:.2g})"
    if max(error["before"], error["after"]) < _SHOWN * error["noise"]:
        return f"the held-out runs do not show {they}: with {they} and without, the {kind} error is the noise {noise}"
    return f"with {they}, the {kind} error on held-out runs {moves if before != after else f'stays at {after}'} {noise}"


def unforeseen(why: str, doubts: Sequence[str] = ()) -> str:
    """What only held-out runs show, where they do, and what to doubt first.

    Args:
        why: in a sentence; empty where they show no more than the others.
        doubts: as for :func:`sentence`.
    """
    return why and f"{why}{_doubted(doubts)}"


def _noise(details: Mapping[str, Any], rounded: bool) -> str:
    """Noise alone, or more than rows show that follow each other so slowly that it may be noise, or the clock's."""
    left = details["unexplained"]["chi2_per_dof"]
    if left < _LOUD:
        return "noise alone"
    if rounded:
        return f"no more than rounding the recorded times may leave: {left:.3g} times the noise (chi2 per dof)"
    return (
        f"no more than noise may: by {left:.3g} times (chi2 per dof) what rows next to each other show of it, which a "
        "filter in the recorder, or errors that last, would hide at this rate. Faster recordings would tell"
    )


def _told(value: float) -> str:
    """Three digits, or as many as tell a gain from one."""
    few = f"{value:.3g}"
    return few if few != "1" else f"{value:.5g}"


def _with_values(effect: NamedEffect) -> str:
    """An effect, where it is, and how much of it."""
    values = [(name, f"{_told(one.value)} {one.unit}".removesuffix(" 1")) for name, one in effect.parameters.items()]
    told = [value if len(values) == 1 else f"{name} {value}" for name, value in values[:_TOLD]]
    return f"{effect.name} at {effect.target}{f' ({_listed(told, len(values))})' if told else ''}"


def _listed(told: Sequence[str], count: int) -> str:
    return ", ".join([*told, *(["..."] if count > len(told) else [])])


def _closest(details: Mapping[str, Any]) -> str:
    """What came closest, and what it leaves, where that is the smaller part."""
    best = next(iter(details.get("rivals", ())), None)
    if best is None or not best["effects"] or details["unexplained"]["share"] > _MOST:
        return ""
    names = _joined([f"{effect['name']} at {effect['target']}" for effect in best["effects"]])
    return (
        f": {names} leave{'s' * (len(best['effects']) == 1)} {best['chi2_per_dof']:.3g} times the noise (chi2 per dof)"
    )


def _doubted(doubts: Sequence[str]) -> str:
    return f" Check the recordings first: {doubts[0]}" if doubts else ""


def _learned(details: Mapping[str, Any]) -> str:
    """How much a learned force mends, where there is one and it does: free runs, or else one step, and both then."""
    kind, error = _measure(details)
    step = details["fit"]["holdout"]["one_step"]
    if error.get("gp") is None:
        return ""
    told, more = (kind, error), ""
    if not _mends(error) and _mends(step):
        told, more = ("one-step", step), f", and the {kind} error from {error['before']:.3g} to {error['gp']:.3g}"
    if not _mends(told[1]):
        return ""
    return (
        f"; with a force learned from the recordings (learned.pt) the {told[0]} error on held-out runs goes from "
        f"{told[1]['before']:.3g} to {told[1]['gp']:.3g} (noise {told[1]['noise']:.2g}){more}"
    )


def _mends(error: Mapping[str, float]) -> bool:
    return error["gp"] < _MENDS * error["before"]


def _measure(details: Mapping[str, Any]) -> tuple[str, Mapping[str, float]]:
    """The errors on held-out runs that tell: of free runs, or by one step where some cannot be forecast freely."""
    holdout = details["fit"]["holdout"]
    wild = not all(entry.get("predictable", True) for entry in holdout["runs"])
    return ("one-step", holdout["one_step"]) if wild else ("free-run", holdout["free_run"])


def _rest(details: Mapping[str, Any]) -> str:
    """A warning where the names leave much more than noise."""
    left = details["unexplained"]
    if left["chi2_per_dof"] < _MUCH_LEFT or left["white"]:
        return ""
    return f"; that is not all, for what is left is still {left['chi2_per_dof']:.2g} times the noise (chi2 per dof)"


def _tied(effect: NamedEffect, several: bool) -> str:
    """An effect, by its name where there are others, and what could stand in its place."""
    others = _joined([f"{name} at {target}" for name, target in effect.ties], "or")
    return f"{f'{effect.name} at {effect.target}' if several else 'it'} from {others}"


def _joined(words: Sequence[str], link: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {link} {words[-1]}"
