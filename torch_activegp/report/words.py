"""Names, targets and degrees of belief in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

_PROPER = {"coulomb": "Coulomb", "stribeck": "Stribeck"}
_BELIEFS = (
    (0.99, "Near certain"),
    (0.95, "Very likely"),
    (0.8, "Likely"),
    (0.5, "More likely than not"),
    (0.0, "A guess"),
)
_BIC_WORDS = ((10.0, "ruled out"), (6.0, "hardly possible"), (2.0, "less likely"), (0.0, "as good"))
AS_IT_IS = "the simulator as it is"


def capital(text: str) -> str:
    """The text with its first letter in upper case, the others as they are."""
    return text[:1].upper() + text[1:]


def effect_name(name: str) -> str:
    """``coulomb_friction`` to ``Coulomb friction``; other names stay in lower case."""
    return " ".join(_PROPER.get(word, word) for word in str(name).split("_"))


def place_name(target: str) -> str:
    """``joint:elbow`` to ``joint elbow``."""
    kind, colon, name = str(target).partition(":")
    return f"{kind} {name}" if colon else kind


def effect_text(effect: Mapping[str, Any]) -> str:
    """One effect: ``Coulomb friction at joint elbow``."""
    name, target = effect_name(effect["name"]), effect.get("target")
    return f"{name} at {place_name(target)}" if target and target != "world" else name


def effects_text(effects: Sequence[Mapping[str, Any]]) -> str:
    """A set of effects as one explanation; the empty set is the simulator itself."""
    return listed(effect_text(effect) for effect in effects) or AS_IT_IS


def listed(items: Iterable[str], word: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    *first, last = [*items] or [""]
    return f"{', '.join(first)} {word} {last}" if first else last


def counted(count: int, noun: str) -> str:
    """``1 run``, ``2 runs``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def belief(probability: float) -> str:
    """A probability as a word: from ``A guess`` to ``Near certain``."""
    return next((word for bound, word in _BELIEFS if probability >= bound), "A guess")


def bic_word(difference: float) -> str:
    """What a difference in BIC to the best explanation means.

    Reference: Kass & Raftery 1995, Bayes factors, section 3.2.
    """
    return next((word for bound, word in _BIC_WORDS if difference >= bound), "as good")


def telling(holdout: Mapping[str, Any]) -> str:
    """Which errors on held-out runs tell: of free runs, or by one step where some cannot be forecast freely."""
    return "free_run" if all(run.get("predictable", True) for run in holdout.get("runs") or []) else "one_step"


def only_closest(diagnosis: Mapping[str, Any], share: float) -> bool:
    """Whether a share of the mismatch is what effects leave that come closest and are not named."""
    return not diagnosis.get("effects") and share < 1.0


def explained(effects: Sequence[Mapping[str, Any]]) -> float:
    """Share of the mismatch that the effects explain together, at most 1."""
    return min(1.0, sum(effect.get("share") or 0.0 for effect in effects))
