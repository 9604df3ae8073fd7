from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.engine import NOMINAL
from torch_activegp.diagnosis.noise_model import NoiseModel
from torch_activegp.diagnosis.numerics import Numerics
from torch_activegp.diagnosis.shooting import Shooting

QUIET = NoiseModel.white(np.array([1e-4]))
RK4, FAST, EULER = (int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("RK4", "IMPLICITFAST", "EULER"))


def machine(bench, integrator: str, step: float, joint: str = ""):
    text = (
        bench.xml.replace("RK4", integrator).replace("0.005", str(step)).replace('name="hip"', f'name="hip" {joint}', 1)
    )
    return dataclasses.replace(bench.machine, model=mujoco.MjModel.from_xml_string(text))


def test_the_forms_of_a_model(bench) -> None:
    made = Numerics.of(machine(bench, "Euler", 0.001), 1)
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
    assert Numerics.of(machine(bench, "Euler", 0.0001), 1).finest is None  # its own steps are short enough
    made = Numerics.of(machine(bench, "RK4", 0.005), 1)
    assert made.coarse.model.opt.integrator == FAST
    assert made.fine is made.given
    assert made.middle is made.fine


def test_a_coarsely_integrated_model_yields_to_the_fine_one(clean) -> None:
    made = Numerics.of(machine(clean, "Euler", 0.01), 1)
    engine, shooting, nominal, judged = made.choose(clean.segments, clean.shooting.noise, clean.nominal, clean.nominal)
    assert engine is made.fine
    assert nominal is judged
    assert nominal.chi2 / shooting.dof == pytest.approx(1.0, abs=0.2)


def test_recordings_of_the_model_itself_keep_its_own_time_step(clean) -> None:
    made = Numerics.of(machine(clean, "Euler", 0.01), 1)
    own = made.given.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0][0]
    noise = clean.noise * np.random.default_rng(0).normal(size=own.shape)
    segments = dataclasses.replace(clean.segments, position=own + noise)
    engine, *_ = made.choose(segments, clean.shooting.noise, clean.nominal, clean.nominal)
    assert engine is made.given


def test_the_numerics_are_judged_with_a_set_where_one_is_given(bench) -> None:
    made = Numerics.of(machine(bench, "Euler", 0.01), 1)
    sets = [((bench.effect("viscous_friction"),), (np.array([0.05]),))]
    engine, shooting, nominal, judged = made.choose(
        bench.segments, bench.shooting.noise, bench.nominal, bench.nominal, sets
    )
    assert engine is made.fine
    assert judged.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    assert nominal.effects == ()
    assert nominal.chi2 > 3 * judged.chi2
    assert judged.chi2 / shooting.dof == pytest.approx(1.0, abs=0.2)


def test_where_a_leapfrog_is_of_first_order_short_steps_are_runge_kuttas(clean, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.numerics.is_of_second_order", lambda model: False)
    made = Numerics.of(machine(clean, "Euler", 0.01, 'frictionloss="0.6"'), 1)
    for form, steps in ((made.finest, 8), (made.firm, 20)):
        assert form is not None
        assert (form.late, form.model.opt.integrator, form.substeps) == (False, RK4, steps)
    assert (made.quick, made.firm_quick) == (None, None)
    assert made.late is not None


@pytest.mark.parametrize("form", ["firm", "fine", "given"])
def test_dry_friction_of_the_model_may_stick_more_firmly_on_the_machine(clean, form: str) -> None:
    """MuJoCo's default lets a stuck joint creep, which is no missing friction."""
    made = Numerics.of(machine(clean, "Euler", 0.005, 'frictionloss="0.6"'), 1)
    assert made.firm is not None
    truth = getattr(made, form)
    own = truth.predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0][0]
    noise = 0.1 * clean.noise * np.random.default_rng(0).normal(size=own.shape)
    shooting = Shooting(made.given, dataclasses.replace(clean.segments, position=own + noise), QUIET)
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    engine, working, _, judged = made.choose(shooting.segments, QUIET, nominal, nominal)
    assert engine is truth
    assert judged.chi2 / working.dof == pytest.approx(1.0, abs=0.25)


def test_a_model_without_friction_has_no_firm_form(clean) -> None:
    assert Numerics.of(machine(clean, "Euler", 0.005), 1).firm is None


def test_firm_friction_is_as_firm_as_that_of_short_steps(clean) -> None:
    """Whatever the model's own time step."""
    firm = Numerics.of(machine(clean, "Euler", 0.01, 'frictionloss="0.6"'), 1).firm
    assert firm is not None
    assert firm.model.dof_solref[0, 0] == pytest.approx(0.0005)
    assert (firm.substeps, firm.late) == (40, True)
