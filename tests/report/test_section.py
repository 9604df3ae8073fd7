from __future__ import annotations

from torch_activegp.report.section import units, with_unit


def test_units_come_from_the_evidence_and_reach_speeds_and_positions() -> None:
    found = units(
        {
            "traces": [{"channel": "qpos.slide", "unit": "m"}],
            "laws": [{"over": "qvel.elbow", "unit_x": "rad/s"}, {"over": "ctrl.m", "unit_x": "V"}],
        }
    )
    assert found == {"qpos.slide": "m", "qvel.slide": "m/s", "qvel.elbow": "rad/s", "qpos.elbow": "rad", "ctrl.m": "V"}
    assert units({}) == {}


def test_axis_labels() -> None:
    assert with_unit("qvel.elbow", {"qvel.elbow": "rad/s"}) == "qvel.elbow [rad/s]"
    assert with_unit("time", {}) == "time [s]"
    assert with_unit("ctrl.m", {}) == "ctrl.m"
