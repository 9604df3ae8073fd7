from __future__ import annotations

import dataclasses
import json

import pytest

from torch_activegp.diagnosis.result import (
    SCHEMA_VERSION,
    Diagnosis,
    EffectStability,
    Estimate,
    NamedEffect,
    Spread,
    Stability,
)


@pytest.fixture
def result() -> Diagnosis:
    effect = NamedEffect(
        "viscous_friction",
        "joint:hip",
        "-c v",
        0.9,
        0.99,
        {"coefficient": Estimate(0.06, "N m s/rad", (0.05, 0.07))},
        (("quadratic_drag", "joint:hip"),),
        True,
    )
    return Diagnosis("tie", "A sentence.", (effect,), {"notes": ["a"]}, {"traces": []}, {"next.csv": "time\n0\n"})


def test_in_words(result) -> None:
    assert str(result).splitlines() == [
        "A sentence.",
        "  viscous_friction at joint:hip: coefficient 0.06 N m s/rad [0.05, 0.07]; explains 90%"
        "; or quadratic_drag at joint:hip",
    ]


@pytest.mark.parametrize(("share", "told"), [(0.0, "0%"), (0.0006, "under 1%"), (0.01, "1%"), (1.0, "100%")])
def test_little_is_not_nothing(result, share: float, told: str) -> None:
    effect = dataclasses.replace(result.effects[0], share=share, ties=())
    assert str(dataclasses.replace(result, effects=(effect,))).endswith(f"; explains {told}")


def test_what_was_fitted_along_is_said(result) -> None:
    along = [{"name": "viscous_friction", "target": "joint:knee", "parameters": {}}]
    found = dataclasses.replace(result, details={**result.details, "retuned": along})
    assert str(found).splitlines()[-1] == "  fitted along and not named: viscous_friction at joint:knee"


def test_as_a_dictionary(result) -> None:
    found = result.to_dict()
    assert (found["schema_version"], found["verdict"], found["notes"]) == (SCHEMA_VERSION, "tie", ["a"])
    (effect,) = found["effects"]
    assert effect["parameters"] == {"coefficient": {"value": 0.06, "unit": "N m s/rad", "ci95": [0.05, 0.07]}}
    assert effect["ties"] == [{"name": "quadratic_drag", "target": "joint:hip"}]
    assert effect["mjcf"] is True


def test_a_warning_about_stability_is_read_and_kept_as_plain_values(result) -> None:
    effect = EffectStability("cogging", "joint:hip", (3.0, None), ("b",), {"phase": Spread(0.1, 0.2, 1.5, "a")})
    for sound in (True, False):
        stable = Stability(("a", "b"), (effect,), "It rests on b.", sound)
        found = dataclasses.replace(result, stability=stable)
        assert ("It rests on b." in str(found)) is not sound
        assert found.to_dict()["stability"] == {
            "left_out": ["a", "b"],
            "effects": [
                {
                    "name": "cogging",
                    "target": "joint:hip",
                    "gains": [3.0, None],
                    "rests_on": ["b"],
                    "fails_without": [],
                    "fails_with": [],
                    "parameters": {"phase": {"low": 0.1, "high": 0.2, "shift": 1.5, "farthest": "a"}},
                }
            ],
            "sentence": "It rests on b.",
            "sound": sound,
        }
    assert result.to_dict()["stability"] is None


def test_the_folder_holds_every_file(result, tmp_path) -> None:
    result.save(tmp_path / "new" / "folder")
    folder = tmp_path / "new" / "folder"
    assert {path.name for path in folder.iterdir()} >= {"diagnosis.json", "evidence.json", "next.csv"}
    assert not [path for path in folder.iterdir() if path.name.endswith(".part")]
    assert json.loads((folder / "diagnosis.json").read_text()) == result.to_dict()
    assert json.loads((folder / "evidence.json").read_text()) == {"traces": []}
    assert (folder / "next.csv").read_text() == "time\n0\n"


def test_an_interrupted_write_leaves_the_old_files(result, tmp_path, monkeypatch) -> None:
    result.save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="disk full"):
        dataclasses.replace(result, sentence="new", files={"next.csv": "new"}).save(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_nothing_of_an_earlier_diagnosis_stays_and_other_files_do(result, tmp_path) -> None:
    files = {"next.csv": "old", "corrected.xml": "<old/>", "learned.pt": b"old"}
    dataclasses.replace(result, files=files).save(tmp_path)
    for name in ("notes.txt", "report.html", "corrected_by_hand.xml"):
        (tmp_path / name).write_text("mine")
    kept = {"diagnosis.json", "evidence.json", "notes.txt", "report.html", "corrected_by_hand.xml"}
    assert {path.name for path in tmp_path.iterdir()} == kept | {*files}
    result.save(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept | {"next.csv"}
    assert (tmp_path / "next.csv").read_text() == "time\n0\n"
    dataclasses.replace(result, files={"corrected.pt": b"new"}).save(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept | {"corrected.pt"}
    assert (tmp_path / "corrected.pt").read_bytes() == b"new"


@pytest.mark.parametrize("too_much", [True, False])
def test_what_the_simulator_has_too_much_of_is_marked(result, too_much: bool) -> None:
    values = {"coefficient": Estimate(0.1, "1", (-1.0, 1.0))}
    effect = NamedEffect("a", "joint:hip", "a law", 0.9, 0.99, values, too_much=too_much)
    assert effect.to_dict()["too_much"] is too_much
    found = str(dataclasses.replace(result, effects=(effect,)))
    assert found.endswith("; explains 90%; the simulator has too much of it" if too_much else "; explains 90%")
