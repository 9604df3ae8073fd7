from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report import render_report
from torch_activegp.report.correction import correction


def test_lines_know_what_they_are(fakes: Any) -> None:
    section = correction(*fakes["named"]())
    assert section.heading == "The correction in the MJCF file: 1 line to change"
    assert [look for look, _ in section.content["lines"]] == [
        "file",
        "file",
        "place",
        "same",
        "removed",
        "added",
        "same",
    ]
    assert section.content["outside"] == "Actuator delay at actuator shoulder_motor"


def test_the_page_holds_the_diff_unchanged_to_copy(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    text = render_report(diagnosis, evidence)
    start = text.index('<pre id="diff"')
    shown = text[text.index("<code>", start) + 6 : text.index("</code>", start)]
    for tag in ("added", "removed", "place", "file", "same"):
        shown = shown.replace(f'<span class="{tag}">', "")
    unescaped = shown.replace("</span>", "").replace("&lt;", "<").replace("&gt;", ">").replace("&#34;", '"')
    assert unescaped == diagnosis["mjcf_diff"]


def test_only_what_mjcf_cannot_hold() -> None:
    effects = [{"name": "backlash", "target": "joint:a", "mjcf": False}, {"name": "constant_force", "mjcf": False}]
    section = correction({"verdict": "named", "effects": effects, "mjcf_diff": None}, {})
    assert section.heading == "MJCF cannot hold the correction"
    assert section.content["outside"] == "Backlash at joint a and constant force"
    assert correction({"verdict": "none"}, {}) is None


@pytest.mark.parametrize(
    ("line", "numerics"),
    [
        ('-  <option timestep="0.002"/>\n+  <option timestep="0.001" integrator="RK4"/>', True),
        ('-  <option timestep="0.001" gravity="0 0 -9.8"/>\n+  <option timestep="0.001" gravity="0 0 -9.5"/>', False),
        ('+  <joint name="option" damping="0.1"/>', False),
        ('   <option timestep="0.001"/>', False),
    ],
)
def test_lines_that_are_numerics_are_told_from_physics(line: str, numerics: bool) -> None:
    found = {"verdict": "named", "mjcf_diff": f"--- nominal\n+++ corrected\n{line}"}
    assert correction(found, {}).content["numerics"] == numerics
    assert ("are numerics, not physics" in render_report(found, {})) == numerics
