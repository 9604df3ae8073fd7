"""The edit of the MJCF file, to read and to copy."""

from __future__ import annotations

import re
from collections.abc import Sequence

from torch_activegp.report.section import Section, Values
from torch_activegp.report.words import capital, counted, effect_text, listed

_NUMERICS = re.compile(r'\b(timestep|integrator)="([^"]*)"')
_LOOKS = {"+": "added", "-": "removed", "@": "place"}


def correction(diagnosis: Values, evidence: Values) -> Section | None:
    """The unified diff, and the effects that MJCF cannot hold; None if there is neither."""
    diff = (diagnosis.get("mjcf_diff") or "").strip("\n")
    outside = [effect_text(effect) for effect in diagnosis.get("effects") or [] if effect.get("mjcf") is False]
    if not (diff or outside):
        return None
    lines = [(_look(line), line) for line in diff.splitlines()]
    changed = max(sum(look == wanted for look, _ in lines) for wanted in ("added", "removed"))
    heading = f"The correction in the MJCF file: {counted(changed, 'line')} to change" if diff else ""
    content = {
        "lines": lines,
        "numerics": _numerics(lines, "added") != _numerics(lines, "removed"),
        "outside": capital(listed(outside)) if outside else "",
        "many": len(outside) > 1,
    }
    return Section("correction", "Correction", heading or "MJCF cannot hold the correction", content)


def _numerics(lines: Sequence[tuple[str, str]], look: str) -> set[tuple[str, str]]:
    """Time step and integrator in the lines of a look."""
    return {found for kind, line in lines if kind == look for found in _NUMERICS.findall(line)}


def _look(line: str) -> str:
    return "file" if line.startswith(("+++", "---")) else _LOOKS.get(line[:1], "same")
