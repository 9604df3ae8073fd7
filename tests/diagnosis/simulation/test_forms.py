from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from tests.diagnosis.cone import cone
from tests.diagnosis.ram import ram
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.simulation.calm import CalmEngine, SmoothEngine
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.forms import Forms

RK4, FAST, EULER = (int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("RK4", "IMPLICITFAST", "EULER"))


def test_the_forms_of_a_model(bench) -> None:
    made = Forms.of(bench.integrated("Euler", 0.001), 1)
    assert (made.given.model.opt.integrator, made.given.substeps) == (EULER, 10)
    assert (made.fine.model.opt.integrator, made.fine.substeps) == (RK4, 10)
    assert (made.middle.model.opt.integrator, made.middle.substeps) == (RK4, 2)
    assert (made.coarse.model.opt.integrator, made.coarse.substeps) == (EULER, 2)
    assert made.late is not None
    assert (made.late.late, made.late.substeps) == (True, 2)
    assert made.finest is not None
    assert (made.finest.late, made.finest.substeps) == (True, 20)
    assert made.quick is not None
    assert (made.quick.late, made.quick.substeps) == (True, 8)
    off = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # nothing touches: a form that stands in need not look for it
    assert [bool(form.model.opt.disableflags & off) for form in (made.finest, made.quick)] == [False, True]
    assert Forms.of(bench.integrated("Euler", 0.0001), 1).finest is None  # its own steps are short enough
    made = Forms.of(bench.integrated("RK4", 0.005), 1)
    assert made.coarse.model.opt.integrator == FAST
    assert made.fine is made.given
    assert made.middle is made.fine


def test_where_a_leapfrog_is_of_first_order_it_competes_with_runge_kutta(clean, monkeypatch) -> None:
    stuck = clean.integrated("Euler", 0.01, 'frictionloss="0.6"')
    second = Forms.of(stuck, 1)
    assert (second.leapt, second.firm_leapt) == (None, None)
    monkeypatch.setattr("torch_activegp.diagnosis.simulation.forms.is_of_second_order", lambda model: False)
    made = Forms.of(stuck, 1)
    for form, steps in ((made.finest, 8), (made.firm, 20)):
        assert form is not None
        assert (form.late, form.model.opt.integrator, form.substeps) == (False, RK4, steps)
    for form, same in ((made.leapt, second.finest), (made.firm_leapt, second.firm)):
        assert form is not None and same is not None
        assert (form.late, form.substeps) == (same.late, same.substeps)
    assert [form.substeps for form in (made.leapt, made.firm_leapt) if form is not None] == [20, 40]
    assert [made.stand_in(form) for form in made.short] == [made.middle, made.quick, made.middle, made.firm_quick]
    assert made.stand_in(made.fine) is made.middle
    assert made.short == (made.finest, made.leapt, made.firm, made.firm_leapt)
    assert [made.sticks(form) for form in made.short] == [False, False, True, True]


def test_a_model_without_friction_has_no_firm_form(clean) -> None:
    assert Forms.of(clean.integrated("Euler", 0.005), 1).firm is None


def test_firm_friction_is_as_firm_as_that_of_short_steps(clean) -> None:
    """Whatever the model's own time step."""
    firm = Forms.of(clean.integrated("Euler", 0.01, 'frictionloss="0.6"'), 1).firm
    assert firm is not None
    assert firm.model.dof_solref[0, 0] == pytest.approx(0.0005)
    assert (firm.substeps, firm.late) == (40, True)


def test_the_models_own_integrator_has_firm_friction_too(clean) -> None:
    """A truth by the model's own scheme whose friction was made firm: Runge-Kutta left 6.8 per dof on a valve."""
    made = Forms.of(clean.integrated("Euler", 0.01, 'frictionloss="0.6"'), 1)
    firm = [form for form in made.own if made.sticks(form)]
    assert [form.substeps for form in firm] == [2, 4, 5, 10, 20]
    assert {(form.late, form.model.opt.integrator) for form in firm} == {(False, EULER)}
    assert [form.model.dof_solref[0, 0] for form in firm] == pytest.approx([0.02 / form.substeps for form in firm])
    assert made.stand_in(firm[-1]) is firm[1]  # which sticks as well
    soft = next(form for form in made.own if form.substeps == 20 and form not in firm)
    assert not made.sticks(made.stand_in(soft))


@pytest.mark.parametrize(("joint", "limit"), [('damping="0.1"', ""), ("", ' kv="1"'), ("", "")])
def test_where_something_brakes_other_simulators_take_its_speed_before_each_step(clean, joint: str, limit: str) -> None:
    drive = f'<position name="drive" joint="hip"{limit}/>'
    machine = clean.integrated("implicitfast", 0.01, joint)
    text = clean.xml.replace('<motor name="drive" joint="hip"/>', drive).replace("RK4", "implicitfast")
    if limit:
        machine = dataclasses.replace(machine, model=mujoco.MjModel.from_xml_string(text.replace("0.005", "0.01")))
    made = Forms.of(machine, 1)
    explicit = [form for form in made.own if form.explicit]
    others = [form for form in made.own if not form.explicit]
    assert [form.substeps for form in explicit] == ([form.substeps for form in others] if joint or limit else [])
    for form in explicit:
        assert form.scheme == (False, EULER, True)
        assert made.stand_in(form) in explicit


def test_what_strikes_now_and_then_takes_long_steps_where_nothing_touches(clean) -> None:
    highest = np.rad2deg(np.quantile(np.concatenate([run.smooth for run in clean.machine.fit]), [0.95, 0.5]))
    seldom, often = (
        Forms.of(clean.integrated("Euler", 0.001, f'limited="true" range="-900 {angle}"'), 1) for angle in highest
    )
    assert seldom.stiff and often.stiff
    assert [isinstance(form, CalmEngine) for form in (seldom.fine, seldom.middle, seldom.coarse)] == [True] * 3
    assert not isinstance(seldom.given, CalmEngine)  # the model as it is
    assert not any(isinstance(form, CalmEngine) for form in vars(often).values())
    dry = Forms.of(clean.integrated("Euler", 0.001, f'limited="true" range="-900 {highest[0]}" frictionloss="0.1"'), 1)
    assert isinstance(dry.coarse, CalmEngine)
    assert not isinstance(dry.fine, CalmEngine)  # where joints stick long steps are not exact


@pytest.mark.parametrize(("kind", "integrator"), [("filterexact", RK4), ("filter", FAST)])
def test_drives_that_are_late_by_half_a_step_keep_their_integrator(clean, kind: str, integrator: int) -> None:
    """MuJoCo holds the state of an exact filter for a step, by Runge-Kutta too."""
    drive = f'<general name="drive" joint="hip" dyntype="{kind}" dynprm="0.02" gainprm="1"/>'
    model = mujoco.MjModel.from_xml_string(clean.xml.replace('<motor name="drive" joint="hip"/>', drive))
    made = Forms.of(dataclasses.replace(clean.machine, model=model), 1)
    assert {form.model.opt.integrator for form in made.own} == {integrator}
    assert not isinstance(made.fine, SmoothEngine)


def test_the_models_own_integrator_in_shorter_steps(clean) -> None:
    plain, precise = (Forms.of(clean.integrated(name, 0.01), 1) for name in ("Euler", "RK4"))
    for made, integrator in ((plain, EULER), (precise, FAST)):
        assert [form.substeps for form in made.own] == [2, 3, 4, 5, 6, 8, 10, 12, 16, 20]
        assert {form.model.opt.integrator for form in made.own} == {integrator}
    assert [plain.stand_in(form).substeps for form in plain.own] == [
        2,
        3,
        4,
        5,
        6,
        4,
        4,
        4,
        4,
        4,
    ]  # of half as many steps or fewer
    assert [form.substeps for form in Forms.of(clean.integrated("Euler", 0.001), 1).own] == [
        20,
        30,
        40,
        50,
        60,
        80,
        100,
    ]
    striking = Forms.of(clean.integrated("RK4", 0.01, 'limited="true" range="-900 10"'), 1)
    assert striking.stiff
    assert [form.substeps for form in striking.own] == [2, 4, 5, 10, 20]  # by the scheme that it has
    short = Forms.of(clean.integrated("RK4", 0.001, 'limited="true" range="-900 10"'), 1)
    assert [form.substeps for form in short.own] == [20, 40, 50]  # none is shorter than 0.2 ms
    assert {form.model.opt.integrator for form in striking.own} == {RK4}
    assert set(striking.own) < set(striking.all)


@pytest.mark.parametrize(
    ("integrator", "joint", "smooth"),
    [
        ("Euler", "", True),
        ("RK4", "", True),
        ("RK4", 'frictionloss="0.1"', False),
        ("RK4", 'stiffness="50000"', False),  # 390 rad/s
        ("RK4", 'limited="true" range="-900 10"', False),
    ],
)
def test_runge_kutta_takes_as_few_steps_as_do_the_same(clean, integrator: str, joint: str, smooth: bool) -> None:
    made = Forms.of(clean.integrated(integrator, 0.001, joint), 1)
    fine = made.fine
    assert (fine.substeps, fine is made.given) == (10, integrator == "RK4")
    assert isinstance(fine, SmoothEngine) is smooth
    if smooth:
        assert fine._calm.substeps == 1
        exact = Engine(made.fine.model, fine.channels, 10, 1)
        where = clean.segments, clean.nominal.starts[None], [NOMINAL]
        assert np.abs(fine.predict(*where) - exact.predict(*where)).max() < 0.01 * clean.noise


@pytest.mark.parametrize(("stiffness", "stride"), [(3.0, 5), (30.0, 2), (3100.0, 1)])
def test_cheap_forms_take_no_longer_steps_than_what_is_stiff_bears(stiffness: float, stride: int) -> None:
    """Semi-implicit Euler flies apart where a step is longer than a third of a period: at 5 ms, from 70 Hz on."""
    machine = cone(stiffness)
    made = Forms.of(machine, 1)
    segments = cut(machine.fit, 0.25, 0.0)
    starts = made.given.starts(segments)[None]
    own = made.given.predict(segments, starts, [NOMINAL])
    for form in (made.coarse, made.late):
        assert form is not None
        assert form.stride == stride
        assert np.abs(form.predict(segments, starts, [NOMINAL]) - own).max() < 0.3 * np.abs(own).max()


def test_a_model_with_long_steps_competes_with_shorter_ones_all_the_same() -> None:
    made = Forms.of(cone(3.0, step=0.01, rate=50), 1)
    assert (made.given.substeps, made.coarse.substeps) == (2, 2)
    assert (made.fine.substeps, made.middle.substeps) == (4, 4)


def test_what_strikes_by_accident_takes_long_steps() -> None:
    """The ram meets its wall in less than one of a hundred poses."""
    made = Forms.of(ram(0.001, 0.01, 1e-4, 800), 1)
    assert not made.stiff
    assert made.coarse.substeps == 2
