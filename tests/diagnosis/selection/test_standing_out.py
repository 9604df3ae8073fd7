from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.ram import ram
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.standing_out import comes_and_goes, stands_out
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine


@pytest.mark.parametrize(
    ("left", "most", "louder", "out"),
    [
        (4.5, 1.0, 0.0, False),
        (5.5, 1.0, 0.0, True),
        (5.5, 1.2, 0.0, False),
        (5.5, 0.1, 0.0, True),
        (5.5, 1.0, 1.5, False),
    ],
)
def test_one_segment_far_above_most_stands_out(bench, left: float, most: float, louder: float, out: bool) -> None:
    samples = bench.segments.samples
    per_segment = most * samples.astype(float)
    per_segment[2] = left * samples[2]
    fit = dataclasses.replace(bench.nominal, per_segment=per_segment, chi2=float(per_segment.sum()))
    assert stands_out(bench.shooting, fit, louder) is out


def test_where_something_touches_nothing_stands_out() -> None:
    machine = ram(step=0.001, soft=0.02, noise=1e-4, rows=300, push=2.0)
    engine = Engine(machine.model, machine.channels, 10, 1)
    segments = cut(machine.fit, 0.25, 0.0)
    shooting = Shooting(engine, segments, NoiseModel.white(np.array([1e-4])))
    nominal = shooting.fit([((), ())], engine.starts(segments))[0]
    reach = [segments.runs[0].smooth[a:b].max() for a, b in segments.scored]
    for number, out in ((int(np.argmin(reach)), True), (int(np.argmax(reach)), False)):
        per_segment = segments.samples.astype(float)
        per_segment[number] *= 9.0
        assert stands_out(shooting, dataclasses.replace(nominal, per_segment=per_segment), 0.0) is out


LOUD = np.array([9.0, 9.0, 9.0])


@pytest.mark.parametrize(
    ("level", "loud", "seen"),
    [
        (1.0, LOUD, True),
        (1.0, LOUD[:1] / 5.0, False),
        (9.0, LOUD, False),
        (9.0, 9.0 * LOUD, True),
        (0.1, LOUD / 9.0, False),
    ],
)
def test_noise_of_any_level_is_always_there_and_a_mismatch_is_not(clean, monkeypatch, level, loud, seen) -> None:
    """Loud in some of thirty segments; at rest a quantised encoder leaves less than its noise."""
    rng = np.random.default_rng(0)
    counts = np.full(30, 40)
    power = level * rng.chisquare(40.0, size=(1, 30))
    power[0, : len(loud)] *= loud / level
    monkeypatch.setattr("torch_activegp.diagnosis.selection.standing_out.by_segment", lambda *_: (power, counts))
    monkeypatch.setattr("torch_activegp.diagnosis.selection.standing_out.touching", lambda *_: np.zeros(1, dtype=bool))
    wide = dataclasses.replace(
        clean.shooting, segments=clean.segments.pick(np.resize(np.arange(clean.segments.size), 30))
    )
    assert comes_and_goes(wide, clean.nominal) is seen


def test_what_comes_and_goes_is_not_seen_in_few_segments_or_a_video_or_where_something_touches(
    clean, monkeypatch
) -> None:
    module = "torch_activegp.diagnosis.selection.standing_out"
    power, counts = np.ones((1, 30)) * 40.0, np.full(30, 40)
    power[0, :3] = 400.0
    shooting = dataclasses.replace(
        clean.shooting, segments=clean.segments.pick(np.resize(np.arange(clean.segments.size), 30))
    )
    monkeypatch.setattr(f"{module}.by_segment", lambda *_: (power, counts))
    assert comes_and_goes(shooting, clean.nominal)
    video = [dataclasses.replace(run, video=True) for run in shooting.segments.runs]
    segments = dataclasses.replace(shooting.segments, runs=tuple(video))
    assert not comes_and_goes(dataclasses.replace(shooting, segments=segments), clean.nominal)
    monkeypatch.setattr(f"{module}.by_segment", lambda *_: (power[:, :9], counts[:9]))
    assert not comes_and_goes(shooting, clean.nominal)
    monkeypatch.setattr(f"{module}.by_segment", lambda *_: (power, counts))
    told = iter(range(30))
    monkeypatch.setattr(f"{module}.touching", lambda *_: np.array([next(told) < 3]))
    assert not comes_and_goes(shooting, clean.nominal)
