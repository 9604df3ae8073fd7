"""Entries of ``diagnosis.json`` that need no whole diagnosis."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.entries import recording_entries, rival_entries
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.score import Score


def test_a_recording_has_the_rows_and_the_rate_that_it_had_and_its_own_notes(bench) -> None:
    run = bench.machine.holdout[0]
    every = np.arange(len(run)) % 4 == 0
    notes = ("kept: a row left out.", "of all", "kept too: no")
    machine = dataclasses.replace(
        bench.machine, holdout=(dataclasses.replace(run, label="kept", recorded=every),), notes=notes
    )
    entry = recording_entries(machine)[-1]
    assert (entry["name"], entry["role"], entry["rows"]) == ("kept", "holdout", every.sum())
    assert entry["rate_hz"] == pytest.approx(0.25 / np.median(run.dt))
    assert entry["notes"] == ["a row left out."]


@pytest.mark.parametrize(("worse", "shown"), [(5.0, 2), (-5.0, 3)])
def test_a_rival_that_was_given_up_in_a_race_is_not_reported(bench, worse, shown) -> None:
    """It fits worse than a part of itself; beside what was fitted, its figures would contradict them."""
    part = bench.fit("viscous_friction", 0.05)
    both = (*part.effects, bench.effect("linear_spring")), (*part.values, np.zeros(1))
    whole = dataclasses.replace(part, effects=both[0], values=both[1], chi2=part.chi2 + worse)
    fits = [part, whole, bench.nominal]
    selection = Selection(bench.nominal, fits, Score(bench.shooting.samples, 10, 1.0))
    explanation = SimpleNamespace(shooting=bench.shooting, selection=selection)
    compared = [(fit, float(i), 0.3) for i, fit in enumerate(fits)]
    rivals = rival_entries(explanation, SimpleNamespace(fit=part, rivals=compared))
    assert len(rivals) == shown
    assert len(rival_entries(explanation, SimpleNamespace(fit=whole, rivals=compared))) == 3  # unless it was chosen
    assert [rival["delta_bic"] for rival in rivals][-1] == 2.0
    (first,) = rivals[0]["effects"]
    assert first["parameters"] == {"coefficient": {"value": part.values[0][0], "unit": "N m s/rad"}}
    assert rivals[-1]["effects"] == []
