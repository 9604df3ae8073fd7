from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection import weak
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.judge import judge
from torch_activegp.diagnosis.selection.omnibus import Omnibus
from torch_activegp.diagnosis.selection.search import select
from torch_activegp.diagnosis.selection.weak import also_weak, with_weak
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import MATERIAL
from torch_activegp.diagnosis.simulation.candidate import Candidate

NOISE = 1e-4
NAMES = ("viscous_friction", "constant_force", "linear_spring", "armature_error")


def recorded(clean, push: float, level: float = NOISE) -> tuple[Shooting, Selection]:
    """A likelihood of much viscous friction and a weak push, and what is chosen."""
    damping, force = clean.effect("viscous_friction"), clean.effect("constant_force")
    truth = Candidate((damping, force), (np.array([0.03]), np.array([push])))
    own = clean.engine.predict(clean.segments, clean.nominal.starts[None], [truth])[0]
    noise = level * np.random.default_rng(0).normal(size=own.shape)
    segments = dataclasses.replace(clean.segments, position=own + noise)
    shooting = Shooting(clean.engine, segments, NoiseModel.white(np.array([level])))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    return shooting, select(shooting, [clean.effect(name) for name in NAMES], nominal)


def test_what_is_weak_is_named_where_only_noise_is_left_behind_it(clean) -> None:
    shooting, chosen = recorded(clean, 0.0025)
    assert {name for name, _ in chosen.best.keys} == {"viscous_friction"}
    assert 1.05 < chosen.score.scale < 1.5
    stages: list[str] = []
    found = also_weak(shooting, chosen, [clean.effect(name) for name in NAMES], stages.append)
    assert {name for name, _ in found.best.keys} == {"viscous_friction", "constant_force"}
    assert found.best.by_effect[clean.effect("constant_force")][0] == pytest.approx(0.0025, rel=0.3)
    assert {effect.name for effect in judge(shooting, found).named} == {"viscous_friction", "constant_force"}
    assert stages[0] == "testing what is weak"
    assert {name for name, _ in chosen.best.keys} == {"viscous_friction"}


@pytest.mark.parametrize(("push", "enough"), [(4e-5, False), (5e-5, True), (1.5e-4, True)])
def test_what_is_weak_is_named_however_little_of_the_whole_it_is(clean, push, enough) -> None:
    """Where it is seen, half of the noise, and nothing but noise is left behind it; not for a little in chi2."""
    shooting, chosen = recorded(clean, push, 0.02 * NOISE)
    left = (chosen.score.scale - 1.0) * shooting.dof / chosen.score.mismatch
    assert {name for name, _ in chosen.best.keys} == {"viscous_friction"}
    assert left < 0.5 * weak._MATERIAL
    found = also_weak(shooting, chosen, [clean.effect(name) for name in NAMES])
    if not enough:
        assert found.best.keys == chosen.best.keys
        return
    assert found.best.by_effect[clean.effect("constant_force")][0] == pytest.approx(push, rel=0.3)
    assert {effect.name for effect in judge(shooting, found).named} == {"viscous_friction", "constant_force"}


@pytest.mark.parametrize(
    ("scale", "part", "looked"), [(1.4, 0.1, True), (2.0, 0.9, True), (2.0, 1.1, False), (5.0, 0.9, False)]
)
def test_nothing_weak_is_looked_for_where_more_is_left_than_is_weak(clean, monkeypatch, scale, part, looked) -> None:
    shooting, chosen = recorded(clean, 0.0025)
    mismatch = (scale - 1.0) * shooting.dof / (part * MATERIAL)
    chosen.score = dataclasses.replace(chosen.score, scale=scale, mismatch=mismatch)
    stages: list[str] = []
    also_weak(shooting, chosen, [clean.effect(name) for name in NAMES], stages.append)
    assert bool(stages) is looked


def test_what_is_weak_has_no_name_where_more_than_noise_is_left_behind_it(clean, monkeypatch) -> None:
    shooting, chosen = recorded(clean, 0.0025)
    effects = [clean.effect(name) for name in NAMES]
    monkeypatch.setattr(weak, "DOUBT", 1.1)  # nothing is noise
    assert also_weak(shooting, chosen, effects).best.keys > chosen.best.keys  # but nearly all of it is gone
    monkeypatch.setattr(weak, "_NEARLY", 0.0)
    assert also_weak(shooting, chosen, effects) is chosen
    work = shooting.work
    short = dataclasses.replace(chosen, cut_short=True)
    assert also_weak(shooting, short, effects) is short
    assert shooting.work == work


def test_nothing_weak_is_looked_for_where_noise_alone_is_left(clean) -> None:
    shooting, chosen = recorded(clean, 0.0)
    stages: list[str] = []
    assert also_weak(shooting, chosen, [clean.effect(name) for name in NAMES], stages.append) is chosen
    assert not stages


def test_nothing_weak_is_looked_for_behind_a_rotor_whose_place_no_recording_holds(clean, monkeypatch) -> None:
    shooting, chosen = recorded(clean, 0.0025)
    monkeypatch.setattr(type(chosen.best.effects[0]), "needs_past", True)
    stages: list[str] = []
    assert also_weak(shooting, chosen, [clean.effect(name) for name in NAMES], stages.append) is chosen
    assert not stages


@pytest.mark.parametrize("name", ["stribeck_friction", "armature_error"])
@pytest.mark.parametrize("noise_alone", [True, False])
def test_as_many_names_with_no_fewer_parameters_are_taken_where_only_noise_is_left_behind_them(
    clean, monkeypatch, noise_alone, name
) -> None:
    """As Stribeck friction in place of Coulomb's: no further name, and all that was left is gone."""
    shooting, chosen = recorded(clean, 0.0025)
    law = clean.effect(name)
    monkeypatch.setattr(weak, "_with_better", lambda selection, *rest: selection)  # at its usual price it is no better
    richer = dataclasses.replace(chosen.best, effects=(law,), values=(law.seeds[0],), chi2=0.5 * chosen.best.chi2)
    seen = weak.Omnibus(1000.0, 1e-9)
    after = weak.Omnibus(0.0, 0.5) if noise_alone else seen
    monkeypatch.setattr(weak, "_MATERIAL", 1e-6)
    monkeypatch.setattr(weak, "search", lambda selection, *rest: selection.add([richer]))
    monkeypatch.setattr(weak, "_unstuck", lambda *rest: None)
    monkeypatch.setattr(weak, "omnibus", lambda shooting, fit: after if law in fit.effects else seen)
    found = also_weak(shooting, chosen, [law])
    assert (found.best is richer) == noise_alone
    assert (found is chosen) != noise_alone


def test_the_same_names_from_other_initial_states_are_nothing_weak(clean, monkeypatch) -> None:
    """Though these leave noise alone: then there was nothing weak to find, and its price is not the selection's."""
    shooting, chosen = recorded(clean, 0.0025)
    begun = dataclasses.replace(chosen.best, chi2=0.9 * chosen.best.chi2)
    monkeypatch.setattr(weak, "search", lambda *_: None)
    monkeypatch.setattr(weak, "chained", lambda *_: begun)
    monkeypatch.setattr(weak, "omnibus", lambda _, fit: Omnibus(0.0, 0.5) if fit is begun else Omnibus(1000.0, 1e-9))
    found = also_weak(shooting, chosen, [])
    assert found.best is begun
    assert found.score.material == chosen.score.material


def test_nothing_weak_is_sought_where_all_that_is_left_looks_like_noise(clean, monkeypatch) -> None:
    monkeypatch.setattr(weak, "omnibus", lambda *_: Omnibus(100.0, 1e-4))
    monkeypatch.setattr(weak, "search", lambda *_: pytest.fail("it was"))
    shooting, chosen = recorded(clean, 0.0025)
    assert also_weak(shooting, chosen, clean.effects) is chosen


@pytest.mark.parametrize("better", [True, False])
def test_a_better_set_that_the_search_for_what_is_weak_comes_across_is_taken(clean, monkeypatch, better: bool) -> None:
    """As strong a name as any, which was missed before: no name more, and it need not leave noise alone."""
    shooting, chosen = recorded(clean, 0.0025)
    other, best = clean.effect("armature_error"), chosen.best
    size = 1e-2 if better else -1e-6
    missed = dataclasses.replace(best, effects=(other,), values=(np.ones(1) * 1e-3,), chi2=best.chi2 * (1.0 - size))
    play = clean.effect("backlash")  # without a gap
    impossible = dataclasses.replace(missed, effects=(play,), values=(np.zeros(1),), chi2=0.1 * best.chi2)
    rich = dataclasses.replace(best, effects=(*best.effects, other), values=(*best.values, np.ones(1) * 1e-3))
    monkeypatch.setattr(weak, "search", lambda selection, *rest: selection.add([missed, impossible, rich]))
    monkeypatch.setattr(weak, "_unstuck", lambda *rest: None)
    monkeypatch.setattr(weak, "omnibus", lambda *rest: weak.Omnibus(1000.0, 1e-9))
    fits, scale = list(chosen.fits), chosen.score.scale
    found = also_weak(shooting, chosen, [other])
    assert (found is not chosen) is better
    assert (found.best is missed) is better
    assert found.fits == [*fits, *([missed] if better else [])]  # what was not wanted tells nothing of the noise
    assert (found.score.scale < scale) is better
    assert (chosen.fits, chosen.score.scale) == (fits, scale)


@pytest.mark.parametrize(
    ("excess", "p_value", "enough"), [(240.0, 1e-9, True), (260.0, 1e-9, False), (900.0, 0.02, True)]
)
def test_a_quarter_of_what_was_left_may_stay_behind_what_is_weak(excess, p_value, enough) -> None:
    assert weak._leaves_noise(Omnibus(1000.0, 1e-30), Omnibus(excess, p_value)) == enough


def test_what_was_compared_and_leaves_noise_alone_is_taken_at_once(clean) -> None:
    """However little of the mismatch it explains; not where more is left, nor where hardly more is left without it."""
    shooting, chosen = recorded(clean, 1.5e-4, 0.02 * NOISE)
    both = [clean.effect(name) for name in NAMES[:2]]
    (rich,) = shooting.fit([(both, (chosen.best.values[0], np.array([1e-4])))], chosen.best.starts)
    chosen.add([rich])
    chosen.rescale(shooting.dof)
    best = chosen.best
    assert len(best.effects) == 1
    assert best.chi2 > 2.0 * shooting.dof > 1.9 * rich.chi2
    assert with_weak(shooting, chosen).best is rich
    assert chosen.best is best
    chosen.cut_short = True
    assert also_weak(shooting, chosen, both).best is rich
    loud = dataclasses.replace(rich, chi2=1.2 * shooting.dof)
    chosen.fits = [chosen.nominal, best, loud]
    assert with_weak(shooting, chosen) is chosen
    quiet = dataclasses.replace(best, chi2=1.4 * shooting.dof)
    chosen.fits = [chosen.nominal, quiet, rich]
    assert with_weak(shooting, chosen) is chosen
    chosen.fits = [chosen.nominal]
    assert with_weak(shooting, chosen) is chosen
