from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.lengths import Lengths
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection.start import Start, with_noise


@pytest.mark.parametrize(
    ("steps", "colour", "lead", "far", "anew"),
    [
        ([0.8], 0.0, "viscous_friction", False, 0),
        ([0.8, 0.6], 0.0, "viscous_friction", False, 1),
        ([1.0], 0.4, "viscous_friction", False, 1),
        ([0.8], 0.0, "quadratic_drag", False, 1),
        ([0.8], 0.0, "viscous_friction", True, 1),
    ],
)
def test_numerics_are_kept_for_much_the_same_noise_behind_the_same_set(
    bench, monkeypatch, steps, colour, lead, far, anew
) -> None:
    """Not for noise that became another one little by little, is slower, or where segments are too far off."""
    numerics, first = Numerics.of(bench.machine, 1), bench.fit("viscous_friction", 0.05)
    engine, shooting, noise = numerics.fine, bench.shooting, bench.shooting.noise
    start = Start(engine, shooting, bench.nominal, [], first, frozenset(), noise)
    if far:
        monkeypatch.setattr("torch_activegp.diagnosis.selection.start.TOO_FAR", 0.1)
        again = Lengths(shooting.segments, bench.nominal, bench.nominal, engine)
        monkeypatch.setattr("torch_activegp.diagnosis.selection.start.longest", lambda *_: again)
    asked: list[int] = []
    monkeypatch.setattr(Numerics, "choose", lambda *_: asked.append(1) or (engine, shooting, bench.nominal, first))
    best = dataclasses.replace(first, effects=(bench.effect(lead),), values=(np.array([0.04]),))
    for step in steps:
        other = NoiseModel(noise.scale * step, np.array([[colour, 0.0]]))
        start = with_noise(bench.machine, numerics, start, best, [], start.free, other, lambda _: None)
    assert len(asked) == anew
    if not anew:
        assert start.shooting.noise is other
        assert start.first.chi2 == pytest.approx(first.chi2 / 0.8**2, rel=1e-3)
        assert start.nominal.chi2 == pytest.approx(bench.nominal.chi2 / 0.8**2, rel=1e-2)


def test_segments_stay_as_long_as_the_best_set_follows_them(bench, monkeypatch) -> None:
    """However far off the nominal is; they are shortened where both are, and chosen anew beside an acceleration."""
    numerics, first = Numerics.of(bench.machine, 1), bench.fit("viscous_friction", 0.05)
    shooting, far = bench.shooting, dataclasses.replace(bench.nominal, per_segment=1e6 * bench.nominal.per_segment)
    start = Start(numerics.fine, shooting, far, [], first, frozenset(), shooting.noise)
    asked: list[int] = []
    again = Lengths(shooting.segments, bench.nominal, bench.nominal, numerics.fine)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.start.longest", lambda *_: asked.append(1) or again)
    shaken = dataclasses.replace(shooting.noise, process=np.array([1e-3]))
    lost = dataclasses.replace(first, per_segment=far.per_segment)
    for best, noise, often in ((first, shooting.noise, 0), (lost, shooting.noise, 1), (first, shaken, 2)):
        with_noise(bench.machine, numerics, start, best, [], start.free, noise, lambda _: None)
        assert len(asked) == often
