from __future__ import annotations

from typing import Any

from torch_activegp.report.sources import sources


def test_recordings_noise_and_notes(fakes: Any) -> None:
    section = sources(*fakes["named"]())
    assert section.heading == "8 recordings, 38.4 s in all"
    assert section.content["rows"][3] == {
        "name": "bench_04.csv", "role": "fitted", "rows": "2\u202f400", "seconds": "4.8", "rate": "500",
        "notes": "a gap of 0.12 s at 2.31 s splits it",
    }  # fmt: skip
    assert section.content["levels"][0] == ("qpos.shoulder", "0.31\u00a0mrad")
    assert len(section.content["notes"]) == 2


def test_what_concerns_one_recording_stands_beside_it(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    own = "bench_04.csv: a gap of 0.12 s at 2.31 s splits it"
    section = sources(diagnosis | {"notes": [own, "bench_05.csv: a gap of 0.12 s at 2.31 s splits it"]}, evidence)
    assert section.content["notes"] == ["bench_05.csv: a gap of 0.12 s at 2.31 s splits it"]


def test_little_is_said_of_little() -> None:
    assert sources({"verdict": "none"}, {}) is None
    section = sources({"verdict": "none", "notes": ["All was clear."]}, {})
    assert section.heading == "What this report stands on"
    assert sources({"verdict": "none", "recordings": [{}]}, {}).content["rows"][0]["rows"] == "\u2013"
