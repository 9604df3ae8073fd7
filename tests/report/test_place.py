from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report.place import place


def test_the_rows_say_where(fakes: Any) -> None:
    section = place(*fakes["named"]())
    assert section is not None
    assert section.heading.replace("\u00a0", " ") == "Joint elbow carries 91 % of the mismatch"
    rows = section.content["rows"]
    assert [row["region"] for row in rows] == [
        "everywhere", "everywhere", "qvel.shoulder \u22120.11 to 0.09 rad/s",
    ]  # fmt: skip
    assert [row["weak"] for row in rows] == [False, False, True]
    assert rows[0]["q"] == "q < 10\u207b\u00b9\u00b2"


def test_a_range_that_holds_nearly_all_that_was_recorded_is_none(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    first = diagnosis["location"][0]
    for ends, text in (([-3.95, 4.0], "everywhere"), ([-3.0, 4.0], "qvel.elbow \u22123 to 4 rad/s")):
        first["region"] = {"qvel.elbow": ends}
        assert place(diagnosis, evidence).content["rows"][0]["region"] == text


@pytest.mark.parametrize("share", [0.05, 0.6])
def test_shares_that_overlap_are_explained(fakes: Any, share: float) -> None:
    diagnosis, evidence = fakes["named"]()
    for found in diagnosis["location"][1:]:
        found["share"] = share
    total = sum(found["share"] for found in diagnosis["location"])
    assert place(diagnosis, evidence).content["overlap"] == (total > 1.005)


def test_the_maps_start_with_the_worst_and_share_one_scale(fakes: Any) -> None:
    charts = place(*fakes["named"]()).content["charts"]
    assert [chart.x.label for chart in charts] == ["qvel.elbow [rad/s]", "qpos.elbow [rad]", "qvel.shoulder [rad/s]"]
    assert len({(chart.y.low, chart.y.high) for chart in charts}) == 1
    assert "worst near" in charts[0].title
    assert charts[0].marks[1].path.startswith("M62.5")  # the first bin has no sample


def test_a_bin_is_told_by_its_mean_force_in_standard_errors_and_next_to_nothing_is_drawn_alike(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    found = evidence["map_region"][0]
    squares = [400.0, *[1.0] * (len(found["before"]) - 1)]
    evidence["map_region"] = [{**found, "count": [9] * len(squares), "before": squares, "after": [1e-5] * len(squares)}]
    (chart,) = place(diagnosis, evidence).content["charts"]
    assert chart.title.endswith(" 20 standard errors")
    assert chart.y.low > 0.1


def test_where_nothing_is_missing_nothing_stands_out(fakes: Any) -> None:
    assert place(*fakes["none"]()).heading == "No part of the motion stands out from the noise"


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_where_nothing_was_corrected_only_one_line_is_drawn(fakes: Any, verdict: str) -> None:
    diagnosis, evidence = fakes[verdict]()
    section = place({**diagnosis, "effects": []}, evidence)
    assert {strip["look"] for strip in section.content["times"]["strips"]} == {"before"}
    assert [mark.look for mark in section.content["charts"][0].marks] == ["noise-level", "before"]


def test_of_many_runs_the_worst_are_shown_in_their_order() -> None:
    runs = [{"run": f"r{index}", "time": [0.5, 1.5], "before": [1.0, float(index)], "after": []} for index in range(30)]
    times = place({"verdict": "unknown"}, {"map_time": runs}).content["times"]
    assert [strip["run"] for strip in times["strips"]] == [f"r{index}" for index in range(6, 30)]
    assert times["left_out"] == "The 24 worst of 30 runs."
    assert (times["axis"].low, times["axis"].high) == (0.0, 2.0)


@pytest.mark.parametrize(("share", "q", "told"), [(None, 0.01, False), (0.4, 0.01, True), (0.002, 0.4, False)])
def test_headings_with_little(share: float | None, q: float, told: bool) -> None:
    """Of a stop that is struck once no bins of forces show anything."""
    section = place({"verdict": "named", "location": [{"target": "world", "share": share, "q_value": q}]}, {})
    assert section.heading == ("World carries 40\u00a0% of the mismatch" if told else "The mismatch sits at world")
    assert place({"verdict": "named"}, {}) is None


def test_time_begins_at_zero_where_the_first_piece_does_not() -> None:
    runs = [{"run": "r", "time": [1.5, 2.5], "seconds": [1.0, 1.0], "before": [1.0, 2.0], "after": []}]
    times = place({"verdict": "unknown"}, {"map_time": runs}).content["times"]
    assert (times["axis"].low, times["axis"].high) == (0.0, 3.0)
