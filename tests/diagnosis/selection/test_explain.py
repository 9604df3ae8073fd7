from __future__ import annotations

import copy
import dataclasses

import mujoco
import numpy as np
import pytest
import torch

from tests.diagnosis.conftest import make_bench
from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.inputs.segments import halve
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.lengths import Lengths
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection import explain as module
from torch_activegp.diagnosis.selection.explain import _finish, _start, explain
from torch_activegp.diagnosis.selection.first_names import Naming, besides, on_a_part
from torch_activegp.diagnosis.selection.search import Depth, select
from torch_activegp.diagnosis.selection.start import Start
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.errors import SimulationError
from torch_activegp.simulators import FunctionSimulator

NAMES = ("viscous_friction", "coulomb_friction", "constant_force", "actuator_delay")


def some(bench):
    return [effect for effect in bench.effects if effect.name in NAMES]


def test_the_sets_are_compared_by_their_own_errors_in_the_end(bench, monkeypatch) -> None:
    """And what is said of them by the correction of the best one."""
    told: list = []

    def corrected(shooting, engine, selection):
        told.append((dataclasses.replace(shooting), engine, selection))
        return told[-1][0]

    monkeypatch.setattr(module, "by_their_own_errors", corrected)
    found = explain(bench.machine, some(bench)[:1], 1)
    ((shooting, engine, selection),) = told
    assert found.shooting is shooting
    assert found.engine is engine
    assert found.selection is selection


@pytest.mark.parametrize("rule", ["of_a_step", "of_held_forces"])
def test_what_may_be_of_a_step_is_asked_of_what_comes_first_in_the_end(bench, monkeypatch, rule: str) -> None:
    """A lag that stood for it became a delay that does the same, and was named."""
    asked: list = []

    def ask(numerics, engine, shooting, selection):
        asked.append((engine, shooting, selection, selection.best))
        return frozenset(selection.best.effects)

    monkeypatch.setattr(module, rule, ask)
    found = explain(bench.machine, some(bench)[:1], 1)
    ((engine, shooting, selection, best),) = asked
    assert (engine, shooting, selection) == (found.engine, found.shooting, found.selection)
    assert best is found.selection.best
    assert found.selection.of_a_step == frozenset(best.effects) != frozenset()


def test_a_static_friction_is_looked_for_before_the_last_fits_and_beside_them(bench, monkeypatch) -> None:
    """A better law is to be polished; and fits that are held beside the best ones are forgotten by their own errors."""
    order = []
    for name in ("try_static_friction", "polish", "by_their_own_errors"):
        found = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *a, of=found, name=name: order.append(name) or of(*a))
    explain(bench.machine, bench.effects, 1)
    assert order == ["try_static_friction", "polish", "by_their_own_errors", "try_static_friction"]


def test_friction_is_found_with_the_level_of_the_noise(bench) -> None:
    stages: list[str] = []
    found = explain(bench.machine, some(bench), 1, stages.append)
    assert found.selection.best.keys == {("viscous_friction", "joint:hip")}
    assert found.selection.best.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    assert found.shooting.noise.scale[0] == pytest.approx(bench.noise, rel=0.15)
    assert found.effects == tuple(some(bench))
    assert stages[0] == "noise floor"
    assert "naming on all data" in stages


@pytest.mark.parametrize("early", [True, False])
def test_a_floor_that_is_too_high_is_taken_anew(bench, monkeypatch, early) -> None:
    """Viscous friction is seen through four times the noise; then the noise is, and with it the friction's interval.

    Where a part of the data has told the friction already, nothing is named on all of it with the floor.
    """
    if early:
        for name in ("_ENOUGH", "FEWEST"):
            monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.explain.noise_floor",
        lambda runs: NoiseModel.white(np.array([4 * bench.noise])),
    )
    stages: list[str] = []
    found = explain(bench.machine, some(bench), 1, stages.append)
    assert stages.count("naming with the noise seen behind the effects") == 1
    anew, named = (
        stages.index(stage) for stage in ("naming with the noise seen behind the effects", "naming on all data")
    )
    assert (anew < named) == early
    assert found.selection.best.keys == {("viscous_friction", "joint:hip")}
    assert found.shooting.noise.scale[0] == pytest.approx(bench.noise, rel=0.15)
    assert found.selection.best.chi2 / found.shooting.dof == pytest.approx(1.0, abs=0.2)


def test_noise_that_nothing_is_missing_behind_is_taken_anew_before_anything_is_named(clean, monkeypatch) -> None:
    """Else a search goes on for what filtered noise, or noise that is quieter than its floor, leaves."""
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.explain.noise_floor",
        lambda runs: NoiseModel.white(np.array([4 * clean.noise])),
    )
    stages: list[str] = []
    found = explain(clean.machine, some(clean), 1, stages.append)
    assert "naming with the noise seen behind the effects" not in stages
    assert not found.selection.best.effects
    assert found.shooting.noise.scale[0] == pytest.approx(clean.noise, rel=0.15)


@pytest.mark.parametrize(("high", "anew"), [(1.3, 1), (4.0, 2)])
def test_numerics_are_judged_again_by_another_noise_only_where_it_is_clearly_another(
    bench, monkeypatch, high, anew
) -> None:
    for name in ("_ENOUGH", "FEWEST"):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    floor = NoiseModel.white(np.array([high * bench.noise]))
    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.noise_floor", lambda runs: floor)
    behind, choose = [], Numerics.choose
    monkeypatch.setattr(Numerics, "choose", lambda *a, **k: behind.append(len(a) > 5 and bool(a[5])) or choose(*a, **k))
    found = explain(bench.machine, some(bench), 1)
    assert sum(behind) == anew
    assert found.selection.best.keys == {("viscous_friction", "joint:hip")}
    assert found.shooting.noise.scale[0] == pytest.approx(bench.noise, rel=0.15)
    assert found.selection.best.chi2 / found.shooting.dof == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("early", [True, False])
def test_numerics_are_looked_at_again_behind_another_set_alone(bench, monkeypatch, early) -> None:
    """Behind the nominal, where little is to be explained at first; else behind the first names, which stay."""
    if early:
        for name in ("_ENOUGH", "FEWEST"):
            monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    known, choose = [], Numerics.choose
    monkeypatch.setattr(Numerics, "choose", lambda *a, **k: known.append(len(a) > 6) or choose(*a, **k))
    assert explain(bench.machine, some(bench), 1).selection.best.keys == {("viscous_friction", "joint:hip")}
    assert known.count(True) == (not early)


@pytest.mark.parametrize("lost", [True, False])
def test_numerics_are_not_looked_at_behind_names_that_leave_most_of_the_mismatch(monkeypatch, lost) -> None:
    """A bump that no mass explains: which form fits better behind that says nothing."""
    bumpy = make_bench("bump")
    for name in ("_ENOUGH", "FEWEST"):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    if not lost:
        monkeypatch.setattr("torch_activegp.diagnosis.selection.first_names.hopeless", lambda *_: False)
    behind, choose = [], Numerics.choose
    monkeypatch.setattr(Numerics, "choose", lambda *a, **k: behind.append(len(a) > 5 and bool(a[5])) or choose(*a, **k))
    tried = [effect for effect in bumpy.effects if effect.name == "payload_mass"]
    found = explain(bumpy.machine, tried, 1)
    assert found.selection.best.effects
    assert sum(behind) == (0 if lost else 1)


def test_the_form_is_kept_where_the_same_names_are_seen_in_longer_segments(bench, monkeypatch) -> None:
    for name in ("_ENOUGH", "FEWEST"):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.first_names.NOISE_ALONE", 0.5)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain._FAR", 1.0)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.noise_behind", lambda *_, **__: None)
    whole = Lengths(bench.segments, bench.nominal, bench.nominal, bench.engine)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.longest", lambda *_: whole)
    noise, halves = bench.shooting.noise, halve(bench.segments, np.ones(bench.segments.size, dtype=bool))
    shooting = Shooting(bench.engine, halves, noise)
    brief = Lengths(halves, shooting.fit([((), ())], bench.engine.starts(halves))[0], bench.nominal, bench.engine)
    chosen, choose = [], Numerics.choose

    def listen(*args, **kwargs):
        found = choose(*args, **kwargs)
        chosen.append((kwargs.get("only"), found[0]))
        return found

    monkeypatch.setattr(Numerics, "choose", listen)
    start = _start(
        bench.machine, Numerics.of(bench.machine, 1), noise, [bench.effect("viscous_friction")], brief, lambda _: None
    )
    assert start.shooting.segments.size == bench.segments.size
    assert start.first.keys == {("viscous_friction", "joint:hip")}
    *before, last = chosen
    assert [only for only, _ in before] == [None] * len(before)
    assert last[0] is last[1] is before[-1][1]


def test_what_is_weak_is_looked_for_by_the_numerics_seen_behind_the_names(bench, monkeypatch) -> None:
    order, choose = [], Numerics.choose
    monkeypatch.setattr(Numerics, "choose", lambda *a, **k: order.append("numerics") or choose(*a, **k))
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.explain.also_weak",
        lambda _, selection, *__: order.append("weak") or selection,
    )
    explain(bench.machine, some(bench), 1)
    assert order == ["numerics", "numerics", "weak"]


@pytest.mark.parametrize("weak", [1, 5])
def test_numerics_are_looked_at_again_behind_weak_names_but_not_for_ever(bench, monkeypatch, weak) -> None:
    """Each search for what is weak finds another set here, ``weak`` times."""
    order, choose = [], Numerics.choose

    def find(shooting, selection, *_):
        order.append("weak")
        if order.count("weak") > weak:
            return selection
        more = bench.effect("constant_force" if order.count("weak") % 2 else "coulomb_friction")
        friction = bench.effect("viscous_friction")
        found = shooting.fit([((friction, more), (np.array([0.05]), np.array([1e-3])))], selection.best.starts)
        return dataclasses.replace(selection, fits=found)

    monkeypatch.setattr(Numerics, "choose", lambda *a, **k: order.append("numerics") or choose(*a, **k))
    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.also_weak", find)
    explain(bench.machine, some(bench), 1)
    assert order == ["numerics", *["numerics", "weak"] * min(weak + 1, 3)]


@pytest.mark.parametrize(("share", "times"), [(0.999, 1), (0.5, 3)])  # 3: where much less is left, look again
def test_a_better_fit_of_the_same_names_ends_the_search_for_what_is_weak(bench, monkeypatch, share, times) -> None:
    """Behind a slide's friction it was sought again and again, each time for 0.1 in chi2."""
    found, polished = [], []

    def find(shooting, selection, *_):
        found.append(dataclasses.replace(selection.best, chi2=share * selection.best.chi2))
        return dataclasses.replace(selection, fits=[*selection.fits, found[-1]])

    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.also_weak", find)
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.explain.polish", lambda _, selection, __: polished.append(selection.best)
    )
    explain(bench.machine, some(bench), 1)
    assert len(found) == times
    assert polished == [found[-1]]


def test_behind_numerics_that_take_a_part_of_the_data_all_goes_on_with_that_part(bench, monkeypatch) -> None:
    sizes, choose = [], Numerics.choose

    def fewer(self, segments, noise, near, nominal, sets=(), known=None):
        if known is None:
            return choose(self, segments, noise, near, nominal, sets)
        sizes.append((segments.size, len(near.starts), len(nominal.starts)))
        part = np.arange(segments.size - 1)
        return copy.copy(known[0]), known[1].pick(part), nominal.pick(part), near.pick(part)

    def find(shooting, selection, *_):
        if len(sizes) > 1:
            return selection
        pair = (bench.effect("viscous_friction"), bench.effect("constant_force"))
        found = shooting.fit([(pair, (np.array([0.05]), np.array([1e-3])))], selection.best.starts)
        return dataclasses.replace(selection, fits=found)

    monkeypatch.setattr(Numerics, "choose", fewer)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.also_weak", find)
    found = explain(bench.machine, some(bench), 1)
    every = sizes[0][0]
    assert sizes == [(every, every, every), (every - 1, every - 1, every - 1)]
    assert found.shooting.segments.size == every - 2


@pytest.mark.parametrize(("short", "quiet"), [(True, False), (True, True), (False, False)])
def test_numerics_are_not_looked_at_behind_a_search_that_ended_in_vain(bench, monkeypatch, short, quiet) -> None:
    """What nothing on the list explains says nothing of numerics either; and no rivals are fitted to their end."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.NOISE_ALONE", 1.1 if quiet else 0.5)
    sought, known, choose = select, [], Numerics.choose

    def stop(*args, **kwargs):
        selection = sought(*args, **kwargs)
        selection.cut_short = short
        return selection

    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.select", stop)
    monkeypatch.setattr(Numerics, "choose", lambda *a, **k: known.append(len(a) > 6) or choose(*a, **k))
    explain(bench.machine, some(bench), 1)
    assert (known.count(True) > 0) == (quiet or not short)


def test_a_coarse_time_step_is_not_taken_for_a_delay(clean) -> None:
    coarse = mujoco.MjModel.from_xml_string(clean.xml.replace("RK4", "Euler").replace("0.005", "0.01"))
    found = explain(dataclasses.replace(clean.machine, model=coarse), some(clean), 1)
    assert found.fine
    assert found.selection.best.effects == ()


def test_nothing_is_found_where_nothing_is_missing(clean) -> None:
    found = explain(clean.machine, some(clean), 1)
    assert found.selection.best.effects == ()
    assert found.selection.nominal.chi2 / found.shooting.dof == pytest.approx(1.0, abs=0.2)


def test_a_set_that_was_fitted_is_not_fitted_again_unless_it_failed(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    own, other = (fit.effects, fit.values), ((bench.effect("quadratic_drag"),), (np.array([0.01]),))
    assert besides([own, other], fit) == [other]
    assert besides([own, other], dataclasses.replace(fit, chi2=np.inf)) == [own, other]


@pytest.mark.parametrize("early", [True, False])
def test_noise_that_was_found_louder_is_the_floor_from_then_on(bench, monkeypatch, early: bool) -> None:
    if early:
        for name in ("_ENOUGH", "FEWEST"):
            monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    floors: list[NoiseModel] = []

    def louder(shooting, fit, floor, last=False):
        if not fit.effects and not floors:
            return None
        floors.append(floor)
        return NoiseModel(1.5 * shooting.noise.scale, shooting.noise.colour) if len(floors) == 1 else None

    monkeypatch.setattr("torch_activegp.diagnosis.selection.explain.noise_behind", louder)
    explain(bench.machine, some(bench), 1)
    assert len(floors) == 2
    np.testing.assert_allclose(floors[1].scale, 1.5 * floors[0].scale)


def test_a_search_by_another_noise_begins_from_what_was_found_and_is_shorter(bench, monkeypatch) -> None:
    depths: list[Depth] = []

    def louder(shooting, fit, floor, last=False):
        return NoiseModel(1.05 * shooting.noise.scale, shooting.noise.colour) if len(depths) == 1 else None

    monkeypatch.setattr(module, "noise_behind", louder)
    monkeypatch.setattr(module, "select", lambda *a: depths.append(a[-1]) or select(*a))
    explain(bench.machine, some(bench), 1)
    first, second = depths[:2]
    assert second.work < first.work
    assert second.more < first.more
    assert second.rounds == first.rounds  # and as deep


def test_a_simulator_that_fails_where_the_machine_was_says_in_which_run(black) -> None:
    inner = black.simulator()

    def step(x: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        after = inner.step(x, u)
        return torch.where((after[..., :1] > 0.2).expand_as(after), torch.nan, after)

    broken = FunctionSimulator(step, inner.state_space, inner.action_space, inner.dt)
    with pytest.raises(SimulationError, match=r"the simulator fails in run\d after .* s \(its state is no number"):
        diagnose(broken, [black.record("none", seed) for seed in (0, 1)], [black.record("none", 9)], nthread=1)


def test_a_simulator_that_fails_on_recordings_in_doubt_says_what_is(bench) -> None:
    failed = dataclasses.replace(bench.nominal, chi2=np.inf)
    with pytest.raises(SimulationError, match="check that it can simulate them"):
        module._refuse_failed(bench.segments, failed, bench.machine)
    doubtful = dataclasses.replace(bench.machine, doubts=("ctrl.motor looks like percent.",))
    with pytest.raises(SimulationError, match=r"Check the recordings first: ctrl.motor looks like percent\.$"):
        module._refuse_failed(bench.segments, failed, doubtful)


@pytest.mark.parametrize("vain", [True, False])
def test_behind_a_search_in_vain_little_more_is_searched(bench, monkeypatch, vain: bool) -> None:
    for name in ("_ENOUGH", "FEWEST"):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    depths: list[Depth] = []
    monkeypatch.setattr(module, "on_a_part", lambda *a: dataclasses.replace(on_a_part(*a), in_vain=vain))
    monkeypatch.setattr(module, "select", lambda *a: depths.append(a[-1]) or select(*a))
    explain(bench.machine, some(bench), 1)
    assert depths
    assert all((depth.work < Depth().work) == vain for depth in depths)
    assert all((depth.work + depth.more < Depth().work) == vain for depth in depths)
    assert (depths[0].rounds == 0) == vain


def test_behind_a_search_in_vain_its_best_set_alone_is_fitted_to_all_data(bench, monkeypatch) -> None:
    pair = (bench.effect("viscous_friction"), bench.effect("constant_force"))
    right, other = ((pair[0],), (np.array([0.05]),)), (pair, (np.array([0.05]), np.array([1e-3])))
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal, [right, other], in_vain=True)
    monkeypatch.setattr(Naming, "wants_a_part", True)
    monkeypatch.setattr(module, "on_a_part", lambda *_: naming)
    whole, numerics = (
        Lengths(bench.segments, bench.nominal, bench.nominal, bench.engine),
        Numerics.of(bench.machine, 1),
    )
    start = _start(bench.machine, numerics, bench.shooting.noise, some(bench), whole, lambda _: None)
    assert start.sets == [right]
    assert start.depth.rounds == 0
    selection = select(start.shooting, some(bench), start.nominal, start.sets, start.first, depth=start.depth)
    assert selection.cut_short
    assert {fit.effects for fit in selection.fits} == {(), right[0]}


def test_numerics_are_not_chosen_again_behind_the_same_names_as_they_were(bench, monkeypatch) -> None:
    """Though they leave more than noise; unless another fit of them leaves much less."""
    calls, choose = [], Numerics.choose
    monkeypatch.setattr(module, "NOISE_ALONE", 0.5)
    monkeypatch.setattr(Numerics, "choose", lambda *a, **k: calls.append(a) or choose(*a, **k))
    fit = bench.fit("viscous_friction", 0.05)
    selection = select(bench.shooting, some(bench), bench.nominal, first=fit)
    numerics = Numerics.of(bench.machine, 1)
    start = Start(bench.engine, bench.shooting, bench.nominal, [], fit, frozenset(), bench.shooting.noise)
    for worse, looked in ((1.1, 0), (2.0, 1)):
        calls.clear()
        judged = dataclasses.replace(fit, chi2=worse * fit.chi2)
        _finish(numerics, some(bench), dataclasses.replace(start, first=judged), selection, lambda _: None)
        assert min(len(calls), 1) == looked
