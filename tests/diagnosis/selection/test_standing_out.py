from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.ram import ram
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.standing_out import stands_out
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
