from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from tests.diagnosis.ram import ram
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.preparation.own_forms import likeliest
from torch_activegp.diagnosis.selection import finer_steps as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.finer_steps import nameless_in_finer_steps, of_a_step, without_a_step
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.places import effects_for

NOISE = 2e-4


@pytest.fixture(scope="module")
def leaning():
    """A ram that leans on a wall half of the time, in quarters of its model's steps: numerics, likelihood, nominal."""
    machine = ram(step=0.005, soft=0.02, noise=NOISE, rows=801, push=6.0, truth=0.005 / 4)
    numerics = Numerics.of(machine, 1)
    segments = cut(machine.fit, 0.25, 0.0)
    shooting = Shooting(numerics.given, segments, NoiseModel.white(np.array([NOISE])))
    nominal = shooting.fit([((), ())], numerics.given.starts(segments))[0]
    effect = next(e for e in effects_for(machine.model, machine.channels, machine.fit) if e.name == "viscous_friction")
    return numerics, shooting, nominal, effect


def named(leaning, left: float, scale: float = 1.0) -> Selection:
    """A selection in which a friction leaves so much of the noise; what the nominal leaves is scaled."""
    _, shooting, nominal, effect = leaning
    nominal = dataclasses.replace(nominal, chi2=scale * nominal.chi2)
    values = (np.array([0.1]),)
    best = dataclasses.replace(nominal, effects=(effect,), values=values, chi2=left * shooting.dof, columns=None)
    return Selection(nominal, [nominal, best], Score(shooting.samples, 60, 1.0))


def test_a_name_that_stands_for_long_steps_is_none(leaning, monkeypatch) -> None:
    numerics, shooting, nominal, _ = leaning
    monkeypatch.setattr("torch_activegp.diagnosis.selection.finer_steps._SMALL", 1e9)
    found = nameless_in_finer_steps(numerics, numerics.given, shooting, named(leaning, 1.5))
    assert nominal.chi2 > 1.5 * shooting.dof
    assert found is not None
    finer, bare = found
    assert finer.engine in numerics.finer
    assert bare.best.effects == ()
    assert bare.best.chi2 < 1.5 * shooting.dof


def test_a_name_stays_where_shorter_steps_do_not_do_as_well(leaning, monkeypatch) -> None:
    numerics, shooting, _, _ = leaning
    monkeypatch.setattr("torch_activegp.diagnosis.selection.finer_steps._SMALL", 1e9)
    assert nameless_in_finer_steps(numerics, numerics.given, shooting, named(leaning, 0.5)) is None


@pytest.mark.parametrize(("part", "all_asked"), [(0.75, True), (0.25, False)])
def test_shorter_steps_that_gain_little_of_it_on_a_part_are_not_fitted_to_all(
    leaning, monkeypatch, part, all_asked
) -> None:
    numerics, shooting, _, effect = leaning
    monkeypatch.setattr("torch_activegp.diagnosis.selection.finer_steps._SMALL", 1e9)
    many = cut(shooting.segments.runs, 0.1, 0.0)
    shooting = dataclasses.replace(shooting, segments=many)
    nominal = shooting.fit([((), ())], shooting.engine.starts(many))[0]
    finest = dataclasses.replace(shooting, engine=numerics.finer[-1]).fit([((), ())], nominal.starts)[0]
    gained = (nominal.per_segment - finest.per_segment) / part  # of what names gain, the finest steps gain a part
    best = named((numerics, shooting, nominal, effect), 1.0).best
    best = dataclasses.replace(best, chi2=nominal.chi2 - gained.sum(), per_segment=nominal.per_segment - gained)
    fitted = []
    plain = Shooting.fit
    monkeypatch.setattr(
        Shooting, "fit", lambda self, *args, **keys: fitted.append(self.segments.size) or plain(self, *args, **keys)
    )
    selection = Selection(nominal, [nominal, best], Score(shooting.samples, 60, 1.0))
    assert nameless_in_finer_steps(numerics, numerics.given, shooting, selection) is None
    assert (many.size in fitted) is all_asked
    assert min(fitted) < many.size


def test_shorter_steps_need_not_gain_what_names_cost(leaning, monkeypatch) -> None:
    """Fitted to all where they gain twice what names are worth beyond their price; once where the part is all."""
    numerics, shooting, nominal, _ = leaning
    module = "torch_activegp.diagnosis.selection.finer_steps"
    for name, value in (("_SMALL", 1e9), ("_HALF", 2.0), ("enough", lambda *_: 1.0)):
        monkeypatch.setattr(f"{module}.{name}", value)
    score, best = Score(shooting.samples, 60, 100.0), named(leaning, 1.0).best
    best = dataclasses.replace(best, chi2=0.01 * nominal.chi2, per_segment=0.01 * nominal.per_segment)
    gained, price = 0.99 * nominal.chi2, score(best) - best.chi2 / score.scale
    fitted, plain = [], Shooting.fit
    monkeypatch.setattr(
        Shooting, "fit", lambda self, *args, **keys: fitted.append(self.segments) or plain(self, *args, **keys)
    )
    for part, needless in ((0.8, True), (0.1, False)):
        fitted.clear()
        dear = dataclasses.replace(score, scale=part * gained / price)  # what a name costs of its gain
        assert dear(nominal) > dear(best)
        found = nameless_in_finer_steps(numerics, numerics.given, shooting, Selection(nominal, [nominal, best], dear))
        assert (found is not None) is needless
    long = [some for some in fitted if some.intervals == shooting.segments.intervals]  # the others are brief pieces
    assert len(long) == 2 * 3


def test_it_is_asked_only_where_little_is_missing_and_something_touches(leaning, bench, monkeypatch) -> None:
    numerics, shooting, nominal, _ = leaning
    for part, asked in ((1.01, True), (0.99, False)):
        least = part * nominal.chi2 / shooting.dof
        monkeypatch.setattr("torch_activegp.diagnosis.selection.finer_steps._SMALL", least)
        assert (nameless_in_finer_steps(numerics, numerics.given, shooting, named(leaning, 1.5)) is not None) is asked
    assert (
        nameless_in_finer_steps(numerics, numerics.given, shooting, Selection(nominal, [nominal], Score(100, 60, 1.0)))
        is None
    )
    assert [form.substeps for form in numerics.finer] == [2 * numerics.given.substeps, 4 * numerics.given.substeps]
    assert Numerics.of(bench.machine, 1).finer == ()


def test_what_is_tied_is_asked_in_all_shorter_steps(clean) -> None:
    """A constraint is as soft as a time step is long: a five-bar's truth had a tenth of its model's."""
    tie = '<equality><joint joint1="hip" active="false"/></equality></mujoco>'
    model = mujoco.MjModel.from_xml_string(clean.xml.replace("</mujoco>", tie))
    for step, times in ((0.005, [2, 4, 5, 10, 20]), (0.001, [2, 4, 5, 10])):  # and not below 0.1 ms
        model.opt.timestep = step
        forms = Numerics.of(dataclasses.replace(clean.machine, model=model), 1)
        assert [form.substeps // forms.given.substeps for form in forms.finer] == times


@pytest.mark.parametrize(("steps", "nameless"), [(5, True), (None, False)])
def test_a_rotor_that_stands_for_explicit_damping_is_no_name(clean, steps: int | None, nameless: bool) -> None:
    """In a simulator of first order it is h D too heavy; one that is too heavy stays, however the model integrates."""
    quiet, machine = 1e-4, clean.integrated("implicitfast", 0.01, 'damping="0.3" armature="0.05"')
    heavy = next(e for e in effects_for(machine.model, machine.channels, machine.fit) if e.name == "armature_error")
    numerics = Numerics.of(machine, 1)
    truth = next((form for form in numerics.own if form.explicit and form.substeps == steps), numerics.fine)
    candidates = [NOMINAL if nameless else Candidate((heavy,), (np.array([-0.006]),))]
    told = truth.predict(clean.segments, clean.nominal.starts[None], candidates)[0]
    position = told + quiet * np.random.default_rng(0).normal(size=told.shape)
    segments = dataclasses.replace(clean.segments, position=position)
    shooting = Shooting(numerics.fine, segments, NoiseModel.white(np.array([quiet])))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    best = shooting.fit([((heavy,), (np.array([-0.001]),))], nominal.starts)[0]
    selection = Selection(nominal, [nominal, best], Score(shooting.samples, 60, 1.0))
    assert best.values[0][0] < 0.0
    assert selection.best is best
    selection.nominal = dataclasses.replace(nominal, chi2=min(nominal.chi2, 1.9 * shooting.dof))
    found = nameless_in_finer_steps(numerics, numerics.fine, shooting, selection)
    assert (found is not None) is nameless
    if found is not None:
        assert found[0].engine is truth
        assert found[1].best.chi2 < 1.2 * shooting.dof


@pytest.mark.parametrize("taken", ["given", "fine"])
def test_a_name_behind_which_the_wrong_form_was_taken_is_none(clean, taken: str) -> None:
    """The other one of those that competed needs none."""
    quiet = 1e-4
    machine = clean.integrated("implicitfast", 0.01, 'damping="0.3"')
    numerics = Numerics.of(machine, 1)
    wrong, truth = (numerics.given, numerics.fine) if taken == "given" else (numerics.fine, numerics.given)
    told = truth.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    position = told + quiet * np.random.default_rng(0).normal(size=told.shape)
    segments = dataclasses.replace(clean.segments, position=position)
    shooting = Shooting(wrong, segments, NoiseModel.white(np.array([quiet])))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    right = dataclasses.replace(shooting, engine=truth).fit([((), ())], nominal.starts)[0]
    assert nominal.chi2 > 1.5 * right.chi2
    best = dataclasses.replace(
        nominal, effects=(clean.effect("viscous_friction"),), values=(np.ones(1),), chi2=right.chi2, columns=None
    )
    best = dataclasses.replace(best, per_segment=right.per_segment)
    selection = Selection(nominal, [nominal, best], Score(shooting.samples, 60, 1.0))
    selection.nominal = dataclasses.replace(nominal, chi2=min(nominal.chi2, 1.9 * shooting.dof))
    found = nameless_in_finer_steps(numerics, wrong, shooting, selection)
    assert found is not None
    assert found[0].engine is truth
    assert found[1].best.effects == ()


@pytest.mark.parametrize("found", [True, False])
def test_a_damping_that_stands_for_half_a_step_beside_another_name(clean, monkeypatch, found: bool) -> None:
    """Behind a stiff servo, whose controls come early in a simulator of first order; one that is missing stays."""
    servo = '<position name="drive" joint="hip" kp="60" kv="3"/>'
    text = clean.xml.replace('<motor name="drive" joint="hip"/>', servo).replace("RK4", "implicitfast")
    model = mujoco.MjModel.from_xml_string(text.replace('name="hip"', 'name="hip" damping="0.5"', 1))
    machine, quiet = dataclasses.replace(clean.machine, model=model), 1e-5
    every = effects_for(model, machine.channels, machine.fit)
    effects = {effect.name: effect for effect in every if len(effect.parameters) == 1}
    load, wet = effects["payload_mass"], effects["viscous_friction"]
    numerics = Numerics.of(machine, 1)
    truth = next(form for form in numerics.own if form.explicit and form.substeps == 10) if found else numerics.fine
    loaded = Candidate((load, wet), (np.array([0.1]), np.array([0.0 if found else -0.1])))
    told = truth.predict(clean.segments, clean.nominal.starts[None], [loaded])[0]
    position = told + quiet * np.random.default_rng(0).normal(size=told.shape)
    segments = dataclasses.replace(clean.segments, position=position)
    shooting = Shooting(numerics.fine, segments, NoiseModel.white(np.array([quiet])))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    best = shooting.fit([((load, wet), (np.array([0.1]), np.array([-0.01])))], nominal.starts)[0]
    alone = dataclasses.replace(best, effects=(wet,), values=best.values[1:])
    asked: list[int] = []
    monkeypatch.setattr(module, "likeliest", lambda *args: asked.append(len(args[2].effects)) or likeliest(*args))
    for some, names in ((best, frozenset([wet]) if found else frozenset()), (alone, frozenset())):
        selection = Selection(nominal, [nominal, some], Score(shooting.samples, 60, 1.0))
        assert selection.best is some
        assert of_a_step(numerics, numerics.fine, shooting, selection) == names
    assert asked == [1]  # not where nothing else is named


@pytest.mark.parametrize(
    ("steps", "beside", "share", "late"),
    [
        (0.4, "backlash", 0.01, True),
        (0.6, "backlash", 0.01, False),
        (0.4, "backlash", 0.1, False),
        (0.4, "viscous_friction", 0.01, False),
    ],
)
def test_what_is_late_by_less_than_half_a_step_beside_what_strikes_is_no_name(
    clean, monkeypatch, steps, beside, share, late
) -> None:
    """It strikes when a step ends; not where much is explained, or by what does not strike."""
    numerics = Numerics.of(clean.machine, 1)
    monkeypatch.setattr(module, "likeliest", lambda *_: [])
    play, delay = clean.effect(beside), clean.effect("actuator_delay", "actuator:drive")
    values = (play.seeds[0], np.array([steps * 0.01 / numerics.fine.substeps]))
    nominal = dataclasses.replace(clean.nominal, chi2=1e5)
    best = dataclasses.replace(nominal, effects=(play, delay), values=values, chi2=1e3)
    rest = dataclasses.replace(nominal, effects=(play,), values=values[:1], chi2=1e3 + share * 99e3)
    monkeypatch.setattr(module, "fitted", lambda *_: rest)
    selection = Selection(nominal, [nominal, best], Score(clean.shooting.samples, 60, 1.0))
    assert selection.best is best
    found = of_a_step(numerics, numerics.fine, clean.shooting, selection)
    assert found == (frozenset([delay]) if late else frozenset())


def test_names_that_were_found_in_such_steps_stay(leaning, monkeypatch) -> None:
    numerics, shooting, _, _ = leaning
    monkeypatch.setattr("torch_activegp.diagnosis.selection.finer_steps._SMALL", 1e9)
    finest = dataclasses.replace(shooting, engine=numerics.finer[-1])
    assert nameless_in_finer_steps(numerics, finest.engine, finest, named(leaning, 1.5)) is None


def test_what_is_late_by_less_than_half_a_step_of_the_own_integrator_is_no_name(clean) -> None:
    """Which then is the nominal, as of recordings that a simulator in other steps has made."""
    numerics = Numerics.of(clean.integrated("Euler", 0.01), 1)
    own = next(form for form in numerics.own if form.substeps == 10)  # 1 ms
    shooting, lag, wet = (
        clean.shooting,
        clean.effect("actuator_lag", "actuator:drive"),
        clean.effect("viscous_friction"),
    )
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]

    def compared(late: float) -> Selection:
        values = (np.array([0.1]), np.array([late]))
        best = dataclasses.replace(nominal, effects=(wet, lag), values=values, chi2=0.5 * nominal.chi2)
        return Selection(nominal, [nominal, best], Score(shooting.samples, 60, 1.0))

    few, many = compared(0.00007), compared(0.0001)  # the next are 0.83 ms
    assert without_a_step(numerics, own, shooting, many) is many
    assert without_a_step(numerics, numerics.fine, shooting, few) is few
    found = without_a_step(numerics, own, shooting, few)
    assert {fit.effects for fit in found.fits} == {(), (wet,)}
    assert found.best.effects == ()


@pytest.mark.parametrize(("own", "steps", "found"), [(True, 0.4, True), (True, 0.6, False), (False, 0.4, False)])
def test_what_is_late_by_less_than_half_an_own_step_is_no_name_where_runge_kutta_does_without(
    bench, monkeypatch, own: bool, steps: float, found: bool
) -> None:
    """Beside a friction that was named, the nominal had come closest in the model's own integrator."""
    numerics = Numerics.of(bench.integrated("Euler", 0.01), 1)
    engine = next(form for form in numerics.own if form.substeps == 10) if own else numerics.fine
    monkeypatch.setattr(module, "likeliest", lambda *_: [])
    wet, delay = bench.fit("viscous_friction", bench.viscous), bench.effect("actuator_delay", "actuator:drive")
    late = steps * 0.01 / engine.substeps
    best = dataclasses.replace(
        wet,
        effects=(*wet.effects, delay),
        values=(*wet.values, np.array([late])),
        chi2=wet.chi2 - 20.0,
        columns=None,
        taken=None,
    )
    for less, names in ((5.0, found), (1e4, False)):  # which leaves as much as Runge-Kutta without it, or far less
        best = dataclasses.replace(best, chi2=wet.chi2 - less)
        selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.0))
        told = of_a_step(numerics, engine, bench.shooting, selection)
        assert told == (frozenset([delay]) if names else frozenset())
