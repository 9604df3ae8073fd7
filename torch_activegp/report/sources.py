"""What the diagnosis stands on: recordings, noise floor, and what the tool had to decide."""

from __future__ import annotations

from typing import Any

from torch_activegp.report.numbers import is_number, number, quantity
from torch_activegp.report.section import Section, Values, units
from torch_activegp.report.words import counted

_ROLES = {"fit": "fitted", "holdout": "held out"}


def sources(diagnosis: Values, evidence: Values) -> Section | None:
    """Recordings, noise and notes; None if the diagnosis brings none of them."""
    known = units(evidence)
    rows = [_row(recording) for recording in diagnosis.get("recordings") or []]
    noise = (diagnosis.get("mismatch") or {}).get("noise") or {}
    levels = [(name, quantity(value, known.get(name, ""))) for name, value in noise.items()]
    told = {
        f"{one.get('name')}: {note}" for one in diagnosis.get("recordings") or [] for note in one.get("notes") or []
    }
    notes = [note for note in diagnosis.get("notes") or [] if note not in told]  # the others stand beside recordings
    model = diagnosis.get("model") or {}
    if not (rows or levels or notes or model):
        return None
    heading = f"{counted(len(rows), 'recording')}, {_seconds(diagnosis)}" if rows else "What this report stands on"
    content = {"rows": rows, "levels": levels, "notes": notes, "model": model}
    return Section("sources", "Recordings", heading, content)


def _row(recording: Values) -> dict[str, Any]:
    return {
        "name": recording.get("name"),
        "role": _ROLES.get(str(recording.get("role")), recording.get("role")),
        "rows": f"{recording['rows']:,}".replace(",", "\u202f") if is_number(recording.get("rows")) else number(None),
        "seconds": number(recording.get("seconds")),
        "rate": number(recording.get("rate_hz")),
        "notes": "; ".join(recording.get("notes") or []),
    }


def _seconds(diagnosis: Values) -> str:
    total = sum(recording.get("seconds") or 0.0 for recording in diagnosis.get("recordings") or [])
    return f"{number(total)} s in all"
