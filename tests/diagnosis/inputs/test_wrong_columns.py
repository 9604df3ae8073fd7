from __future__ import annotations

import pytest

from torch_activegp.diagnosis.inputs import wrong_columns as module
from torch_activegp.diagnosis.inputs.wrong_columns import doubt_columns
from torch_activegp.errors import DataError


@pytest.fixture
def told(monkeypatch) -> None:
    monkeypatch.setattr(module, "check_units", lambda model, channels, runs: [f"unit in {run}" for run in runs])
    monkeypatch.setattr(module, "doubt_controls", lambda model, channels, runs: ["sign"])
    monkeypatch.setattr(module, "doubt_limits", lambda model, recordings: [f"limit in {one}" for one in recordings])


def test_the_most_certain_doubt_comes_first(model, channels, told) -> None:
    found = doubt_columns(model, channels, ["file"], ["fitted"], ["held out"])
    assert found == ["unit in fitted", "unit in held out", "sign", "limit in file"]


@pytest.mark.parametrize("controls", [["a control is in kN."], []])
def test_where_a_unit_is_refused_a_control_may_be_what_is_wrong(model, channels, told, monkeypatch, controls) -> None:
    def refuse(*_) -> list[str]:
        raise DataError("mm, for m.")

    monkeypatch.setattr(module, "check_units", refuse)
    monkeypatch.setattr(module, "doubt_controls", lambda *_: controls)
    with pytest.raises(DataError) as error:
        doubt_columns(model, channels, [], [])
    assert str(error.value) == " Or another column is: ".join(["mm, for m.", *controls])
