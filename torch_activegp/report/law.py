"""The laws, each drawn over the residual force that it explains."""

from __future__ import annotations

import numpy as np

from torch_activegp.report.axis import axis_over
from torch_activegp.report.chart import Chart, dots, level, line, whiskers
from torch_activegp.report.numbers import is_number, percent
from torch_activegp.report.section import Section, Values, with_unit
from torch_activegp.report.words import capital, counted, effect_text, listed

_MOST_WHISKERS = 150
_TWO_SIDED_95 = 1.96


def law(diagnosis: Values, evidence: Values) -> Section | None:
    """One chart for each law; None if the evidence holds none."""
    laws = [found for found in evidence.get("laws") or [] if len(found.get("x") or [])]
    if not laws:
        return None
    effects = {(effect["name"], effect.get("target")): effect for effect in diagnosis.get("effects") or []}
    charts = [_chart(found, effects.get((found["name"], found.get("target")))) for found in laws]
    heading = f"The law{'s' if len(laws) > 1 else ''} over the force that the simulator misses"
    drawn = {(found["name"], found.get("target")) for found in laws}
    others = [capital(effect_text(effect)) for key, effect in effects.items() if key not in drawn]
    return Section("law", "Law" if len(laws) == 1 else "Laws", heading, {"charts": charts, "others": listed(others)})


def _chart(found: Values, effect: Values | None) -> Chart:
    x_data, force = (np.asarray(found[key], dtype=float) for key in ("x", "force"))
    deviation = np.asarray(found.get("force_sd") or np.zeros_like(force), dtype=float)
    law_x, law_y = (np.asarray(found.get(key) or [], dtype=float) for key in ("law_x", "law_y"))
    shown = force[np.isfinite(force)]
    spread = np.percentile(shown, [0.5, 99.5]) if shown.size > _MOST_WHISKERS else shown
    few = len(x_data) <= _MOST_WHISKERS and bool((deviation > 0).any())
    reach = _TWO_SIDED_95 * np.where(np.isfinite(deviation), deviation, np.nan)
    x = axis_over(with_unit(found["over"], {found["over"]: found.get("unit_x") or ""}), x_data, law_x)
    y = axis_over(with_unit("missing force", {"missing force": found.get("unit_y") or ""}), spread, law_y, margin=0.12)
    marks = [level("zero", y, 0.0)] if y.low < 0 < y.high else []
    if few:
        marks.append(whiskers("whiskers", x, y, (x_data, force - reach, force + reach)))
    label = f"residual force ({counted(len(x_data), 'point')}{', bars 95 %' if few else ''})"
    marks.append(dots("dots few" if few else "dots", x, y, (x_data, force), label))
    if law_x.size:
        marks.append(
            line("law", x, y, (law_x, law_y), f"law: {effect['law']}" if effect and effect.get("law") else "law")
        )
    return Chart(_title(found, effect), x, y, marks)


def _title(found: Values, effect: Values | None) -> str:
    name = capital(effect_text(found))
    if effect is None:
        return f"{name}: not among the named effects"
    share = effect.get("share")
    name += ", of which the simulator has too much," if effect.get("too_much") else ""
    return f"{name} explains {percent(share)} of the mismatch" if is_number(share) else name.rstrip(",")
