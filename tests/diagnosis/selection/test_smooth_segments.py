from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.ram import ram
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection import screening
from torch_activegp.diagnosis.selection.screening import screen
from torch_activegp.diagnosis.selection.smooth_segments import smooth_segments
from torch_activegp.diagnosis.shooting.chaining import chained
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import Linearization, linearize
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.places import effects_for

NOISE = 2e-4


@pytest.fixture(scope="module")
def pushed() -> tuple[Shooting, Fit]:
    """A ram that strikes a wall twice a second, and the fit by a model whose coil pushes less."""
    machine = ram(step=0.001, soft=0.02, noise=NOISE, rows=401)
    weaker = dataclasses.replace(machine.fit[0], control=machine.fit[0].control - 0.2)
    engine = Engine(machine.model, machine.channels, 10, 1)
    shooting = Shooting(engine, cut([weaker], 0.25, 0.1), NoiseModel.white(np.array([NOISE])))
    return shooting, chained(shooting, shooting.fit([((), ())], engine.starts(shooting.segments))[0])


def broken(linear: Linearization, which: list[int]) -> Linearization:
    """As finite differences across an impact are in some segments."""
    force = linear.force.copy()
    force[which, 18] *= 300.0
    return dataclasses.replace(linear, force=force)


def test_segments_with_derivatives_of_any_size_are_left_out(pushed) -> None:
    linear = linearize(*pushed)
    kept = smooth_segments(*pushed, linear)
    assert 2 * len(kept) >= len(linear.states)
    wild = [int(kept[1]), int(kept[-2])]
    assert smooth_segments(*pushed, broken(linear, wild)).tolist() == [s for s in kept if s not in wild]


def test_all_count_where_more_than_half_are_wild(pushed) -> None:
    size = pushed[0].segments.size
    assert len(smooth_segments(*pushed, broken(linearize(*pushed), list(range(size // 2 + 1))))) == size


def test_all_count_where_nothing_touches(bench) -> None:
    linear = broken(linearize(bench.shooting, bench.nominal), [0])
    assert len(smooth_segments(bench.shooting, bench.nominal, linear)) == bench.segments.size


def test_a_push_is_seen_beside_a_wild_segment(pushed, monkeypatch) -> None:
    shooting, fit = pushed
    engine, segments = shooting.engine, shooting.segments
    effects = [e for e in effects_for(engine.model, engine.channels, segments.runs) if e.name == "constant_force"]
    sound = screen(shooting, fit, effects).best()[0]
    assert sound.values == pytest.approx([0.2], rel=0.3)
    linear = linearize(shooting, fit)
    kept = smooth_segments(shooting, fit, linear)
    monkeypatch.setattr(screening, "linearize", lambda *_: broken(linear, [int(kept[1])]))
    seen = screen(shooting, fit, effects).best()[0]
    assert seen.gain == pytest.approx(sound.gain, rel=0.2)
    assert seen.values == pytest.approx(sound.values, rel=0.1)
