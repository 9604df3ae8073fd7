"""What the data cannot tell, and the next recording that would tell."""

from __future__ import annotations

from typing import Any

from torch_activegp.report.numbers import is_number, percent
from torch_activegp.report.reading import holds_nothing, nothing
from torch_activegp.report.section import Section, Values
from torch_activegp.report.words import capital, effect_name, effect_text, listed, only_closest

_MUCH = 0.05


def unknowns(diagnosis: Values, evidence: Values) -> Section:
    """Ties, what is left unexplained, the limits of the recordings, and the next experiment."""
    points = [*_ties(diagnosis), *_rest(diagnosis), *_loose(diagnosis), _limits(diagnosis)]
    following = diagnosis.get("next_experiment")
    heading = "What these recordings cannot tell"
    if following and following.get("needed", True):
        heading += ", and the one that would"
    return Section("unknowns", "Open questions", heading, {"points": points, "next": _next(following)})


def _ties(diagnosis: Values) -> list[str]:
    return [
        f"Whether it is {listed([effect_text(effect), *map(effect_text, effect['ties'])], 'or')}: in these recordings "
        "they move the machine alike."
        for effect in diagnosis.get("effects") or []
        if effect.get("ties")
    ]


def _rest(diagnosis: Values) -> list[str]:
    left = diagnosis.get("unexplained") or {}
    share, white = left.get("share"), left.get("white")
    if diagnosis["verdict"] == "none" or not is_number(share):
        return []
    if only_closest(diagnosis, share):
        return [f"What makes up the mismatch: the effects that come closest leave {percent(share)} of it."]
    if white is False:
        return [f"What makes up the {percent(share)} left unexplained: it still has structure, so it is not noise."]
    if share >= _MUCH:
        return [f"What makes up the {percent(share)} left unexplained: it cannot be told from noise."]
    return []


def _loose(diagnosis: Values) -> list[str]:
    points = []
    for origin, word in ((0.0, "zero"), (1.0, "one")):
        names = [
            f"the {name.replace('_', ' ')} of {effect_text(effect)}"
            for effect in diagnosis.get("effects") or []
            for name, found in (effect.get("parameters") or {}).items()
            if nothing(effect["name"], name) == origin and holds_nothing(effect["name"], name, found.get("ci95"))
        ]
        verb = "is" if len(names) == 1 else "are"
        points += [f"Whether {listed(names)} {verb} above or below {word}: the interval holds both."] if names else []
    return points


def _limits(diagnosis: Values) -> str:
    if diagnosis["verdict"] == "none":
        return "Effects too weak to rise above the noise, or that act only where these recordings never went."
    return "What happens at speeds, loads and positions that these recordings never reached."


def _told(words: str) -> str:
    """An effect's name as the report writes it; a parameter and its value as they are."""
    return words if " " in words else effect_name(words)


def _next(following: Values | None) -> dict[str, Any] | None:
    if not following:
        return None
    return {
        "heading": "Record this next" if following.get("needed", True) else "The next recording",
        "why": capital(str(following.get("why") or "")),
        "separates": listed((_told(words) for words in following.get("separates") or []), "from"),
        "controls": following.get("controls") or "",
    }
