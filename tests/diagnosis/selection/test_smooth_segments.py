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
    every = list(range(pushed[0].segments.size))
    assert smooth_segments(*pushed, linear).tolist() == every  # what it foresees too little of outweighs nobody
    wild = [1, len(every) - 2]
    assert smooth_segments(*pushed, broken(linear, wild)).tolist() == [s for s in every if s not in wild]


def test_all_count_where_most_are_wild(pushed) -> None:
    """No other segment says what is usual."""
    size = pushed[0].segments.size
    assert len(smooth_segments(*pushed, broken(linearize(*pushed), list(range(size // 2 + 2))))) == size


def test_all_count_where_nothing_touches(bench) -> None:
    linear = broken(linearize(bench.shooting, bench.nominal), [0])
    assert len(smooth_segments(bench.shooting, bench.nominal, linear)) == bench.segments.size


@pytest.mark.parametrize("held", [0, 12])
def test_a_joint_that_is_held_in_most_segments_says_nothing_of_the_others(pushed, held: int) -> None:
    linear = linearize(*pushed)
    force = linear.force.copy()
    force[:held] = 0.0
    kept = smooth_segments(*pushed, broken(dataclasses.replace(linear, force=force), [14]))
    assert (14 in kept) is (held > 0)
    assert len(kept) == linear.states.shape[0] - (held == 0)


def test_a_push_is_seen_beside_wild_segments(pushed, monkeypatch) -> None:
    """As much of it as all segments would show."""
    shooting, fit = pushed
    engine, segments = shooting.engine, shooting.segments
    effects = [e for e in effects_for(engine.model, engine.channels, segments.runs) if e.name == "constant_force"]
    sound = screen(shooting, fit, effects).best()[0]
    assert sound.values == pytest.approx([0.2], rel=0.3)
    linear = linearize(shooting, fit)
    monkeypatch.setattr(screening, "linearize", lambda *_: broken(linear, [1, 3, 6, 8, 11, 14]))
    seen = screen(shooting, fit, effects).best()[0]
    assert seen.gain == pytest.approx(sound.gain, rel=0.25)
    assert seen.values == pytest.approx(sound.values, rel=0.1)
