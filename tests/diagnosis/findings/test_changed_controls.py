from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.findings import changed_controls as module
from torch_activegp.diagnosis.findings.changed_controls import driven, parts_of, with_controls
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.score import Score


def found(clean) -> Explanation:
    selection = Selection(clean.nominal, [clean.nominal], Score(clean.shooting.samples, 60, 1.0))
    return Explanation(clean.engine, clean.shooting, selection, (), given=clean.engine)


def test_a_control_that_rests_drives_nothing(clean) -> None:
    assert driven(found(clean)) == {"drive": 0}
    runs = tuple(dataclasses.replace(run, control=np.full_like(run.control, 0.3)) for run in clean.segments.runs)
    still = dataclasses.replace(clean.shooting, segments=dataclasses.replace(clean.segments, runs=runs))
    assert driven(dataclasses.replace(found(clean), shooting=still)) == {}


def test_controls_are_changed_in_all_runs_and_nothing_else(clean) -> None:
    changed = with_controls(found(clean), lambda run: dataclasses.replace(run, control=-2.0 * run.control))
    for before, after in zip(clean.segments.runs, changed.segments.runs, strict=True):
        np.testing.assert_array_equal(after.control, -2.0 * before.control)
        assert after.position is before.position
    assert changed.offset is None


def test_a_part_comes_before_all_segments(clean, monkeypatch) -> None:
    size = clean.segments.size
    for share, counts in ((0.3, [6, size]), (1.0, [size])):
        monkeypatch.setattr(module, "enough", lambda engine, segments, share=share: share)
        assert [len(part) for part in parts_of(found(clean))] == counts
