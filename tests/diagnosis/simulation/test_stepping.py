from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.simulation import stepping
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine


def candidates_on(bench) -> list[Candidate]:
    """All that reaches a simulation without being done before every step."""
    rng = np.random.default_rng(0)
    force = rng.normal(size=(bench.segments.size, bench.segments.intervals, 1))
    steady = Candidate((bench.effect("constant_force"),), (np.array([0.2]),))
    late = Candidate((bench.effect("actuator_delay", "actuator:drive"),), (np.array([0.013]),))
    loaded = Candidate((bench.effect("payload_mass", "body:rod"),), (np.array([0.1]),))
    return [NOMINAL, steady, late, loaded, Candidate(force=force)]


def both_ways(bench, monkeypatch, engine: Engine, candidates: list[Candidate], segments=None) -> list[np.ndarray]:
    """States in one call and step by step."""
    segments = bench.segments if segments is None else segments
    starts = np.repeat(bench.nominal.starts[None], len(candidates), axis=0)
    out = []
    for fewer in (0, np.inf):
        monkeypatch.setattr(stepping, "_FEWER", fewer)
        out.append(engine.predict(segments, starts, candidates))
    return out


@pytest.mark.parametrize("options", [{}, {"late": True}, {"stride": 3}, {"stride": 3, "late": True}])
def test_one_call_and_step_by_step_give_the_same(bench, monkeypatch, options) -> None:
    substeps = 1 if "stride" in options else 2
    engine = Engine(bench.machine.model, bench.engine.channels, substeps, 1, **options)
    for candidates in (candidates_on(bench), candidates_on(bench)[:2]):
        at_once, stepped = both_ways(bench, monkeypatch, engine, candidates)
        np.testing.assert_allclose(at_once, stepped, rtol=0.0, atol=1e-12)
        assert np.abs(at_once[1:] - at_once[0]).max(axis=(1, 2, 3)).min() > 1e-4


def test_memory_bounds_the_steps_of_one_call_and_changes_nothing(bench, monkeypatch) -> None:
    at_once, _ = both_ways(bench, monkeypatch, bench.engine, candidates_on(bench))
    monkeypatch.setattr(stepping, "_BYTES", 1)
    one_each, _ = both_ways(bench, monkeypatch, bench.engine, candidates_on(bench))
    np.testing.assert_allclose(at_once, one_each, rtol=0.0, atol=1e-12)


def test_every_step_has_its_own_length(bench, monkeypatch) -> None:
    rng = np.random.default_rng(1)
    uneven = dataclasses.replace(bench.segments, dt=bench.segments.dt * rng.uniform(0.5, 1.5, bench.segments.dt.shape))
    at_once, stepped = both_ways(bench, monkeypatch, bench.engine, [NOMINAL], uneven)
    np.testing.assert_allclose(at_once, stepped, rtol=0.0, atol=1e-12)
    even, _ = both_ways(bench, monkeypatch, bench.engine, [NOMINAL])
    assert np.abs(at_once - even).max() > 1e-3


def test_a_simulation_that_fails_on_the_way_is_nan_both_ways(bench, monkeypatch) -> None:
    force = np.zeros((bench.segments.size, bench.segments.intervals, 1))
    force[3, 10:] = 1e12
    for read in both_ways(bench, monkeypatch, bench.engine, [Candidate(force=force), NOMINAL]):
        assert np.isnan(read[0, 3]).all()
        assert np.isfinite(np.delete(read[0], 3, axis=0)).all()
        assert np.isfinite(read[1]).all()


def test_inputs_of_several_rows_are_made_together(bench, monkeypatch) -> None:
    calls = []
    make = stepping.Inputs.__call__

    def listen(self, edges):
        calls.append(len(edges))
        return make(self, edges)

    monkeypatch.setattr(stepping.Inputs, "__call__", listen)
    monkeypatch.setattr(stepping, "_FEWER", np.inf)
    starts = np.repeat(bench.nominal.starts[None], 5, axis=0)
    monkeypatch.setattr(stepping, "_TOGETHER", 1)
    one_each = bench.engine.predict(bench.segments, starts, candidates_on(bench))
    assert calls == [1] * bench.segments.intervals
    monkeypatch.setattr(stepping, "_TOGETHER", 16)
    together = bench.engine.predict(bench.segments, starts, candidates_on(bench))
    assert max(calls) == 16
    np.testing.assert_array_equal(one_each, together)
