from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection import cut_short as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.cut_short import try_in_place
from torch_activegp.diagnosis.shooting.score import Score


def found(bench, loud: float) -> Selection:
    """A drag in place of the damping that is there, by noise that is so many times what it is."""
    noise = NoiseModel.white(np.array([loud * bench.noise]))
    shooting = dataclasses.replace(bench.shooting, noise=noise)
    drag = bench.effect("quadratic_drag")
    nominal, best = shooting.fit([((), ()), ((drag,), (np.array([0.02]),))], bench.nominal.starts)
    return shooting, Selection(nominal, [nominal, best], Score(shooting.samples, 60, 1.0), cut_short=True)


def test_what_is_there_is_found_in_place_of_a_name_though_a_search_was_cut_short(bench) -> None:
    shooting, selection = found(bench, 1.0)
    drag = selection.best
    assert 1.1 < drag.chi2 / shooting.dof < 3.0
    try_in_place(selection, shooting, bench.effects, np.inf)
    assert selection.best.effects == (bench.effect("viscous_friction"),)
    assert selection.best.chi2 < 1.1 * shooting.dof


@pytest.mark.parametrize(("loud", "known", "asked"), [(1.0, False, True), (1.0, True, False), (3.0, False, False)])
def test_others_are_tried_once_and_where_more_than_noise_is_left(bench, monkeypatch, loud, known, asked) -> None:
    shooting, selection = found(bench, loud)
    selection.swapped = frozenset(selection.best.effects) if known else frozenset()
    swapped, aliases = [], []
    monkeypatch.setattr(module, "swap", lambda *args: swapped.append(args[-1]))
    monkeypatch.setattr(module, "try_aliases", lambda *args: aliases.append(args))
    try_in_place(selection, shooting, bench.effects, 7.0)
    assert (swapped, len(aliases)) == ([7.0] if asked else [], 1)
