from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation import agreement, numerics, telling
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.preparation.rivals import Rival
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate

QUIET = NoiseModel.white(np.array([1e-4]))


def test_a_coarsely_integrated_model_yields_to_the_fine_one(clean) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    engine, shooting, nominal, judged = made.choose(clean.segments, clean.shooting.noise, clean.nominal, clean.nominal)
    assert engine is made.fine
    assert nominal is judged
    assert nominal.chi2 / shooting.dof == pytest.approx(1.0, abs=0.2)


def test_recordings_of_the_model_itself_keep_its_own_time_step(clean) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    own = made.given.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    noise = clean.noise * np.random.default_rng(0).normal(size=own.shape)
    segments = dataclasses.replace(clean.segments, position=own + noise)
    engine, *_ = made.choose(segments, clean.shooting.noise, clean.nominal, clean.nominal)
    assert engine is made.given


def test_a_form_that_was_taken_before_may_be_the_only_one(clean) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    shooting = truth_of(clean, made, "fine", 0.1)
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    before = [form.work for form in made.own]
    engine, *_ = made.choose(shooting.segments, shooting.noise, nominal, nominal, only=made.given)
    assert engine is made.given  # though the recordings are nearly continuous in time
    assert [form.work for form in made.own] == before


@pytest.mark.parametrize(("number", "cost"), [(0, 2), (4, 6), (6, 10)])
def test_a_simulation_by_the_models_integrator_in_shorter_steps_is_found(clean, number: int, cost: int) -> None:
    """In 5, 1.7 or 1 ms for 10 ms; the controls of either come half a step early, which no other form has."""
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    truth = made.own[number]
    assert truth.substeps == cost
    own = truth.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    noise = 0.05 * clean.noise * np.random.default_rng(0).normal(size=own.shape)
    quiet = NoiseModel.white(np.array([0.05 * clean.noise]))
    segments = dataclasses.replace(clean.segments, position=own + noise)
    nominal = Shooting(made.given, segments, quiet).fit([((), ())], clean.nominal.starts)[0]
    engine, shooting, fit, _ = made.choose(segments, quiet, nominal, nominal)
    assert engine is truth
    assert fit.chi2 / shooting.dof == pytest.approx(1.0, abs=0.25)


def test_the_numerics_are_judged_with_a_set_where_one_is_given(bench) -> None:
    made = Numerics.of(bench.integrated("Euler", 0.01), 1)
    sets = [((bench.effect("viscous_friction"),), (np.array([0.05]),))]
    engine, shooting, nominal, judged = made.choose(
        bench.segments, bench.shooting.noise, bench.nominal, bench.nominal, sets
    )
    assert engine is made.fine
    assert judged.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    assert nominal.effects == ()
    assert nominal.chi2 > 3 * judged.chi2
    assert judged.chi2 / shooting.dof == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("form", ["firm", "fine", "given"])
def test_dry_friction_of_the_model_may_stick_more_firmly_on_the_machine(clean, form: str) -> None:
    """MuJoCo's default lets a stuck joint creep, which is no missing friction."""
    made = Numerics.of(clean.integrated("Euler", 0.005, 'frictionloss="0.6"'), 1)
    assert made.firm is not None
    truth = getattr(made, form)
    own = truth.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    noise = 0.1 * clean.noise * np.random.default_rng(0).normal(size=own.shape)
    shooting = Shooting(made.given, dataclasses.replace(clean.segments, position=own + noise), QUIET)
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    engine, working, _, judged = made.choose(shooting.segments, QUIET, nominal, nominal)
    assert engine is truth
    assert judged.chi2 / working.dof == pytest.approx(1.0, abs=0.25)


def test_what_comes_late_by_less_than_a_few_time_steps_is_seen_in_shorter_ones_too(clean) -> None:
    made = Numerics.of(clean.integrated("RK4", 0.01), 1)
    late = clean.effect("actuator_lag", "actuator:drive")
    for seconds, short in ((0.015, True), (0.025, False)):
        forms = made._forms(clean.segments, [((late,), (np.array([seconds]),))], None)
        assert (made.finest in forms) is short


def test_a_lag_within_a_time_step_is_no_delay_behind_long_steps(clean) -> None:
    """The form and the way to be late are chosen together."""
    made = Numerics.of(clean.integrated("RK4", 0.01), 1)
    lag, delay = (clean.effect(name, "actuator:drive") for name in ("actuator_lag", "actuator_delay"))
    truth = Candidate((lag,), (np.array([0.008]),))
    own = made.finest.predict(clean.segments, clean.nominal.starts[None], [truth])[0]
    noise = 0.02 * clean.noise * np.random.default_rng(0).normal(size=own.shape)
    quiet = NoiseModel.white(np.array([0.02 * clean.noise]))
    shooting = Shooting(made.given, dataclasses.replace(clean.segments, position=own + noise), quiet)
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    sets = [((late,), (np.array([0.008]),)) for late in (delay, lag)]
    engine, *_, judged = made.choose(shooting.segments, quiet, nominal, nominal, sets)
    assert (engine, judged.effects) == (made.finest, (lag,))


def test_either_scheme_of_short_steps_may_be_closer_behind_an_effect_that_is_held(clean, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.simulation.forms.is_of_second_order", lambda model: False)
    made = Numerics.of(clean.integrated("Euler", 0.005, 'frictionloss="0.6"'), 1)
    held, smooth = clean.effect("joint_stop"), clean.effect("viscous_friction")
    always = [made.given, made.fine, made.firm, made.firm_leapt]
    assert made._forms(clean.segments, [((smooth,), (np.zeros(1),))], None) == always
    assert made._forms(clean.segments, [((held,), (np.zeros(1),))], None) == [*always, made.finest, made.leapt]


def test_friction_of_the_model_may_be_closer_by_leapfrog(clean, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.simulation.forms.is_of_second_order", lambda model: False)
    made = Numerics.of(clean.integrated("Euler", 0.005, 'frictionloss="0.6"'), 1)
    truth = made.firm_leapt
    assert truth is not None
    own = truth.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    noise = 0.01 * clean.noise * np.random.default_rng(0).normal(size=own.shape)
    quiet = NoiseModel.white(np.array([0.01 * clean.noise]))
    shooting = Shooting(made.given, dataclasses.replace(clean.segments, position=own + noise), quiet)
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    engine, *_ = made.choose(shooting.segments, quiet, nominal, nominal)
    assert engine is truth


def truth_of(bench, made: Numerics, form: str, loud: float = 1.0) -> Shooting:
    """The likelihood of what one of the forms would have recorded."""
    own = getattr(made, form).predict(bench.segments, bench.nominal.starts[None], [NOMINAL])[0]
    noise = loud * bench.noise * np.random.default_rng(0).normal(size=own.shape)
    segments = dataclasses.replace(bench.segments, position=own + noise)
    return Shooting(made.given, segments, NoiseModel.white(np.array([loud * bench.noise])))


def test_a_hopeless_form_is_given_up_after_one_fit(clean, monkeypatch) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    shooting = truth_of(clean, made, "fine", 0.1)
    settled = []

    def listen(working, judged, rest, rounds):
        assert not rest  # nothing sticks
        assert rounds == agreement._CREEPS
        settled.append(judged.chi2 / working.dof)
        return judged

    monkeypatch.setattr(agreement, "chained", listen)
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    assert nominal.chi2 > 10 * shooting.dof
    engine, *_ = made.choose(shooting.segments, shooting.noise, nominal, nominal)
    assert engine is made.fine
    assert max(settled) < 2.0
    once = len(settled)
    monkeypatch.setattr(numerics, "too_far", lambda *_: np.inf)
    made.choose(shooting.segments, shooting.noise, nominal, nominal)
    assert len(settled) == 2 * once
    assert max(settled) < 2.0
    monkeypatch.setattr(numerics, "_NEAR", 0.0)
    made.choose(shooting.segments, shooting.noise, nominal, nominal)
    assert max(settled) > 4.0


def test_the_cheapest_form_that_is_close_comes_first(clean, monkeypatch) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    shooting = truth_of(clean, made, "fine")
    fit = shooting.fit([((), ())], clean.nominal.starts)[0]
    precise = dataclasses.replace(shooting, engine=made.fine)
    rival = Rival.at(shooting, made.fine, fit)
    far = {id(made.coarse): 50.0, id(made.late): 20.0}
    monkeypatch.setattr(numerics, "unabsorbed", lambda working, fit: far[id(working.engine)])
    assert made._cheap_ones(rival, precise, fit) == [made.late, made.coarse, made.fine]
    far[id(made.coarse)] = 29.0
    assert made._cheap_ones(rival, precise, fit) == [made.coarse, made.late, made.fine]
    stiff = dataclasses.replace(made, stiff=True)
    far[id(made.coarse)] = 50.0
    assert stiff._cheap_ones(rival, precise, fit)[0] is made.coarse


def test_runge_kutta_in_few_steps_may_stand_for_many_of_first_order(clean, monkeypatch) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.005), 1)
    shooting = truth_of(clean, made, "fine")
    fit = shooting.fit([((), ())], clean.nominal.starts)[0]
    monkeypatch.setattr(numerics, "unabsorbed", lambda working, fit: 99.0)
    steps = {form: form.steps_in(shooting.segments) for form in made.all}
    alike = next(form for form in made.own if steps[made.middle] < steps[form] < 3 * steps[made.middle])
    many = next(form for form in made.own if steps[form] > 3 * steps[made.middle])
    for form, there in ((alike, False), (many, True)):
        precise = dataclasses.replace(shooting, engine=form)
        for stiff in (False, True):
            some = dataclasses.replace(made, stiff=stiff)._cheap_ones(Rival.at(shooting, form, fit), precise, fit)
            assert (made.middle in some) is (there and not stiff)
    precise = dataclasses.replace(shooting, engine=made.given)
    assert steps[made.coarse] == steps[made.given] < steps[made.middle]
    rival = Rival.at(shooting, made.given, fit)
    assert made._cheap_ones(rival, precise, fit) == [made.coarse, made.late, made.given]
    only = dataclasses.replace(made, coarse=made.given)  # as of a black box
    assert only._cheap_ones(rival, precise, fit) == [made.given]


@pytest.mark.parametrize("close", [True, False])
def test_where_something_touches_a_form_must_fit_all_segments_as_the_engine_does(clean, monkeypatch, close) -> None:
    made = dataclasses.replace(Numerics.of(clean.integrated("Euler", 0.001), 1), stiff=True)
    shooting = truth_of(clean, made, "fine")
    begin = shooting.fit([((), ())], clean.nominal.starts)[0]
    monkeypatch.setattr(agreement, "is_close", lambda working, judged, exact, carried: close and exact is not None)
    working, judged = made._on_all(dataclasses.replace(shooting, engine=made.middle), made.fine, begin)
    assert working.engine is (made.middle if close else made.fine)
    assert (working.offset is not None) == close
    assert judged.chi2 / working.dof == pytest.approx(1.0, abs=0.2)
    assert working.cheap is made.coarse


@pytest.mark.parametrize("fair", [True, False])
def test_where_something_touches_a_form_must_do_justice_to_the_nominal_too(clean, fair) -> None:
    """A correction made behind a set may spoil the nominal, which the precise form fits as it is."""
    made = Numerics.of(clean.integrated("Euler", 0.001), 1)
    shooting = truth_of(clean, made, "fine")
    precise = dataclasses.replace(shooting, engine=made.fine)
    nominal = precise.fit([((), ())], clean.nominal.starts)[0]
    judged = precise.fit([((clean.effect("viscous_friction"),), (np.array([0.001]),))], nominal.starts)[0]
    working = dataclasses.replace(shooting, engine=made.middle).corrected(made.fine, judged)
    bare = dataclasses.replace(nominal, chi2=(1.01 if fair else 1.1) * nominal.chi2)
    chosen, other, again = agreement.just(working, precise, nominal, bare, judged)
    assert (chosen is working and other is bare and again is judged) == fair
    if not fair:
        assert chosen is precise
        assert other.chi2 == pytest.approx(nominal.chi2, abs=0.1)
        assert again.chi2 == pytest.approx(judged.chi2, abs=0.1)


def test_where_something_touches_only_forms_that_are_close_in_brief_pieces_are_fitted(clean, monkeypatch) -> None:
    made = dataclasses.replace(Numerics.of(clean.integrated("Euler", 0.01), 1), stiff=True)
    leaves = {id(form): 200.0 for form in made.all} | {id(made.own[1]): 100.0, id(made.fine): 109.0}
    monkeypatch.setattr(numerics, "left_in_brief", lambda shooting, form, fit: leaves[id(form)])
    shooting = truth_of(clean, made, "fine")
    fit = shooting.fit([((), ())], clean.nominal.starts)[0]
    found = made._rivals([made.given, made.fine], shooting, fit)
    assert [(rival.engine, rival.left) for rival in found] == [(made.fine, 109.0), (made.own[1], 100.0)]


@pytest.mark.parametrize(
    ("left", "gains", "asked", "begun"),
    [(1.04, 0.0, [], [1]), (1.07, 0.005, [1], [1, 2]), (1.2, 0.02, [1, 2], [1, 2, 3]), (2.5, 0.04, [1, 2], [])],
)
def test_where_something_touches_shorter_steps_are_asked_last_as_long_as_they_leave_less(
    clean, monkeypatch, left: float, gains: float, asked: list[int], begun: list[int]
) -> None:
    """And where little is left, each form begins where the best one ended."""
    made = dataclasses.replace(Numerics.of(clean.integrated("Euler", 0.01), 1), stiff=True)
    shooting = truth_of(clean, made, "fine")
    fit = shooting.fit([((), ())], clean.nominal.starts)[0]
    own = made.own[1:3]
    rivals = [Rival(form, np.zeros(0), 90.0 + i, 90.0) for i, form in enumerate((*own, made.given, made.fine))]
    fitted: list = []
    done: list = []

    def work(self, rival, first, rough, lost):
        fitted.append((rival.engine, rough))
        done.append(dataclasses.replace(fit, chi2=(left - gains * (len(fitted) - 1)) * first.dof))
        return shooting, done[-1]

    monkeypatch.setattr(Numerics, "_working", work)
    made._race(rivals, shooting, fit, [], shooting.dof)
    assert {form for form, _ in fitted[:2]} == {made.given, made.fine}
    assert [made.own.index(form) for form, _ in fitted[2:]] == asked
    assert [number for number, (_, rough) in enumerate(fitted) if number and rough is done[number - 1]] == begun


@pytest.mark.parametrize(("integrator", "tried"), [("Euler", [7]), ("RK4", [0, 7])])
def test_one_length_of_step_tells_of_the_others(clean, integrator: str, tried: list[int]) -> None:
    made = Numerics.of(clean.integrated(integrator, 0.01), 1)
    own = made.own[7].predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    noise = 0.05 * clean.noise * np.random.default_rng(0).normal(size=own.shape)
    quiet = NoiseModel.white(np.array([0.05 * clean.noise]))
    shooting = Shooting(made.fine, dataclasses.replace(clean.segments, position=own + noise), quiet)
    fit = shooting.fit([((), ())], clean.nominal.starts)[0]
    before = [form.work for form in made.own]
    found = made._rivals(list(dict.fromkeys((made.given, made.fine))), shooting, fit)
    assert found[-1].engine is made.own[7]
    assert [i for i, form in enumerate(made.own) if form.work > before[i]] == tried


def test_shorter_steps_that_are_no_better_are_not_tried_where_much_is_left(bench) -> None:
    made = Numerics.of(bench.integrated("Euler", 0.01), 1)
    fit = Shooting(made.fine, bench.segments, bench.shooting.noise).fit([((), ())], bench.nominal.starts)[0]
    shooting = dataclasses.replace(bench.shooting, engine=made.fine)
    before = [form.work for form in made.own]
    found = made._rivals([made.given, made.fine], shooting, fit)
    assert min(rival.left for rival in found) > 2.0 * shooting.dof
    assert [rival.engine for rival in found] == [made.given, made.fine]
    assert [form.work for form in made.own] == before


def test_forms_that_fail_tell_nothing_of_shorter_steps(clean, monkeypatch) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    truth, shooting = made.own[7], truth_of(clean, made, "fine")
    own = truth.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    noise = 0.05 * clean.noise * np.random.default_rng(0).normal(size=own.shape)
    quiet = NoiseModel.white(np.array([0.05 * clean.noise]))
    shooting = Shooting(made.fine, dataclasses.replace(clean.segments, position=own + noise), quiet)
    fit = shooting.fit([((), ())], clean.nominal.starts)[0]
    sought = made.given.predict

    def fail(*args):
        predicted = sought(*args)
        predicted[:, 0] = np.nan
        return predicted

    monkeypatch.setattr(made.given, "predict", fail)
    found = made._rivals([made.given, made.fine], shooting, fit)
    assert found[-1].engine is truth
    engine, *_ = made.choose(shooting.segments, quiet, fit, fit, only=made.given)
    assert engine is truth  # the one that was taken before fails, and all compete


def test_where_few_lengths_are_left_they_are_tried_behind_what_sticks(clean) -> None:
    made = Numerics.of(clean.integrated("Euler", 0.0003), 1)
    assert len(made.own) == 2
    dry = clean.effect("coulomb_friction")
    fit = clean.shooting.fit([((dry,), (np.array([0.01]),))], clean.nominal.starts)[0]
    forms = [made.given, made.fine, made.own[0]]
    assert len(made._rivals(forms, clean.shooting, fit)) >= 3


def test_discretisation_alone_tells_nothing(clean, monkeypatch) -> None:
    """A fit of the nominal by a coarse form leaves much, and nothing is missing."""
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    shooting = truth_of(clean, made, "fine", 0.1)
    coarse = shooting.fit([((), ())], clean.nominal.starts)[0]
    monkeypatch.setattr(telling, "_JUDGES", 1)
    monkeypatch.setattr(telling, "_AFFORDED", 1.0)
    monkeypatch.setattr(telling, "_PLENTY", 0.5 * coarse.chi2)
    assert coarse.chi2 > 10 * shooting.dof
    _, working, _, judged = made.choose(shooting.segments, shooting.noise, coarse, coarse)
    assert working.segments.size == shooting.segments.size
    assert judged.chi2 / working.dof == pytest.approx(1.0, abs=0.2)


def test_behind_names_that_leave_more_than_noise_the_own_integrator_is_tried_once_more(clean, monkeypatch) -> None:
    """What seemed no closer before the names were fitted, may be behind them."""
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    shooting = truth_of(clean, made, "fine", 0.1)
    own, friction = made.own[0], (clean.effect("coulomb_friction"),)
    fit = shooting.fit([(friction, (np.array([0.001]),))], clean.nominal.starts)[0]
    asked: list[float] = []
    now: dict[str, float] = {}

    def closer(_, forms, first, rough, rivals):
        assert made.fine in [rival.engine for rival in rivals]
        asked.append(rivals[0].left)
        return [Rival(own, np.zeros(0), now["nearer"] * rivals[0].left, now["least"])]

    monkeypatch.setattr("torch_activegp.diagnosis.preparation.numerics.own_rivals", closer)
    monkeypatch.setattr(Numerics, "_working", lambda *_: (shooting, dataclasses.replace(fit, chi2=now["chi2"])))
    dof = shooting.dof
    loud, quiet = (dataclasses.replace(fit, chi2=times * dof) for times in (2.0, 1.0))
    bare = dataclasses.replace(loud, effects=(), values=())
    for judged, nearer, least, chi2, looked, taken in (
        (loud, 0.5, 0.5, dof, 1, True),
        (loud, 0.5, 0.5, 3.0 * dof, 1, False),
        (loud, 0.99, 0.5, dof, 1, False),
        (loud, 0.5, 2.5, dof, 1, False),  # no parameters promise to bring it closer than what is known
        (quiet, 0.5, 0.5, 0.1 * dof, 0, False),
        (bare, 0.5, 0.5, dof, 0, False),
    ):
        asked.clear()
        now |= {"nearer": nearer, "chi2": chi2, "least": least * dof}
        engine, _, best = made._own_behind(judged.chi2, made.given, shooting, judged, shooting, dof)
        assert len(asked) == looked
        assert (engine is own) == taken
        assert best.chi2 == (chi2 if taken else judged.chi2)


def test_the_second_look_at_the_own_integrator_asks_forms_of_any_length(clean) -> None:
    """As it is, with nothing replaced: truth in short steps of the model's own integrator, names off by something."""
    made = Numerics.of(clean.integrated("Euler", 0.01), 1)
    shooting = truth_of(clean, made, "fine", 0.1)
    truth = made.own[3].predict(shooting.segments, clean.nominal.starts[None], [NOMINAL])[0]
    seen = dataclasses.replace(shooting, segments=dataclasses.replace(shooting.segments, position=truth))
    friction = (clean.effect("viscous_friction"),)
    working = dataclasses.replace(seen, engine=made.given, noise=QUIET)
    fit = working.fit([(friction, (np.array([0.001]),))], clean.nominal.starts)[0]
    assert fit.chi2 > 2.0 * working.dof
    engine, _, best = made._own_behind(fit.chi2, made.given, working, fit, working, working.dof)
    assert engine in made.own
    assert best.chi2 < 0.1 * fit.chi2


def test_a_name_that_may_be_half_a_time_step_is_left_out_where_the_own_integrator_does_without(clean) -> None:
    """Damping that Runge-Kutta wants of a stiff servo that was simulated in steps of 2 ms."""
    servo = '<general joint="hip" gainprm="5" biastype="affine" biasprm="0 -5 -0.1"/>'
    xml = clean.xml.replace('<motor name="drive" joint="hip"/>', servo)
    machine = dataclasses.replace(clean.integrated("Euler", 0.01), model=mujoco.MjModel.from_xml_string(xml))
    machine.model.opt.timestep, machine.model.opt.integrator = 0.01, 0
    made = Numerics.of(machine, 1)
    truth = next(form for form in made.own if form.substeps == 5)
    seen = truth.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    segments = dataclasses.replace(
        clean.segments, position=seen + 1e-5 * np.random.default_rng(0).normal(size=seen.shape)
    )
    working = Shooting(made.fine, segments, NoiseModel.white(np.array([1e-5])))
    fit = working.fit([((clean.effect("viscous_friction"),), (np.zeros(1),))], clean.nominal.starts)[0]
    engine, _, best = made._own_behind(np.inf, made.fine, working, fit, working, working.dof)
    assert (engine, best.effects) == (truth, ())


@pytest.mark.parametrize(("late", "fitted"), [(0.002, 2), (0.05, 1)])
def test_behind_a_delay_of_a_few_steps_all_forms_are_fitted(clean, monkeypatch, late: float, fitted: int) -> None:
    """A form that has controls early wants a longer one, which seems far off by another one."""
    made = Numerics.of(clean.integrated("Euler", 0.005), 1)
    shooting, delay = truth_of(clean, made, "fine"), clean.effect("actuator_delay", "actuator:drive")
    rough = shooting.fit([((delay,), (np.array([late]),))], clean.nominal.starts, hold=True)[0]
    worked = []

    def work(self, rival, first, rough, lost):
        worked.append(rival.engine)
        return first, dataclasses.replace(rough, chi2=float(first.dof))

    monkeypatch.setattr(Numerics, "_working", work)
    monkeypatch.setattr(Numerics, "_own_behind", lambda self, *a: a[1:4])
    monkeypatch.setattr(numerics, "too_far", lambda *_: -np.inf)
    monkeypatch.setattr(numerics, "distinct", lambda rivals, *_: rivals)
    rivals = [Rival.at(shooting, form, rough) for form in (made.given, made.fine)]
    made._race(rivals, shooting, rough, [], shooting.dof)
    assert len(worked) == fitted


@pytest.mark.parametrize(
    ("ends", "forms", "begun", "last"),
    [
        ([2.0, 1.0], ["coarse", "fine"], [None, 0], 1),
        ([np.inf, 1.0], ["coarse", "fine"], [None, None], 1),  # the one that is close failed
        ([2.0, np.inf, 1.0], ["coarse", "fine", "fine"], [None, 0, None], 2),  # it led astray
        ([2.0, np.inf, np.inf], ["coarse", "fine", "fine"], [None, 0, None], None),
    ],
)
def test_where_something_touches_all_data_are_fitted_first_by_the_form_that_is_known_to_be_close(
    clean, monkeypatch, ends, forms: list[str], begun, last: int | None
) -> None:
    made = dataclasses.replace(Numerics.of(clean.integrated("Euler", 0.01), 1), stiff=True)
    working, begin = dataclasses.replace(truth_of(clean, made, "fine"), engine=made.coarse), clean.nominal
    fits = [dataclasses.replace(begin, chi2=chi2) for chi2 in ends]
    seen: list = []

    def settled(shooting, engine, judged, *_, rest):
        assert not rest  # which was tried as the segments were cut
        seen.append((shooting.engine, judged))
        return shooting, fits[len(seen) - 1]

    monkeypatch.setattr(numerics, "settled", settled)
    monkeypatch.setattr(
        numerics, "first_close", lambda precise, forms, judged, exact, known, rest=True: (precise, (judged, exact))
    )
    _, found = made._on_all(working, made.fine, begin)
    assert [form for form, _ in seen] == [getattr(made, name) for name in forms]
    assert all(fit is (begin if number is None else fits[number]) for (_, fit), number in zip(seen, begun, strict=True))
    assert found is begin if last is None else found == (fits[last], fits[last])
    smooth = dataclasses.replace(made, stiff=False)
    assert smooth._on_all(working, made.fine, begin)[1] == (begin, None)
    assert len(seen) == len(forms)


@pytest.mark.parametrize(
    ("joint", "stiff", "effect", "tried"),
    [
        ("", True, "viscous_friction", False),
        ("", True, "coulomb_friction", True),
        ("", False, "viscous_friction", False),
        ("", False, "coulomb_friction", True),
        ('frictionloss="1e-5"', False, "viscous_friction", True),
        ('frictionloss="1e-5"', True, "viscous_friction", False),  # as the segments were cut
    ],
)
def test_rest_is_tried_again_where_something_may_hold_a_joint(
    bench, clean, monkeypatch, joint: str, stiff: bool, effect: str, tried: bool
) -> None:
    seen: list[bool] = []

    def listen(shooting, fit, rest=True, rounds=60):
        seen.append(rest)
        return fit

    monkeypatch.setattr(agreement, "chained", listen)
    made = dataclasses.replace(Numerics.of(clean.integrated("Euler", 0.01, joint), 1), stiff=stiff)
    shooting = truth_of(clean, made, "fine")
    fit = shooting.fit([((clean.effect(effect),), (np.array([1e-4]),))], clean.nominal.starts, 2)[0]
    made._working(Rival.at(shooting, made.fine, fit), shooting, fit, np.inf)
    made._on_all(dataclasses.replace(shooting, engine=made.coarse), made.fine, fit)
    assert set(seen) == {tried}
