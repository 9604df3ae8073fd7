from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.engine import NOMINAL
from torch_activegp.diagnosis.numerics import Numerics

RK4, FAST, EULER = (int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("RK4", "IMPLICITFAST", "EULER"))


def machine(bench, integrator: str, step: float):
    text = bench.xml.replace("RK4", integrator).replace("0.005", str(step))
    return dataclasses.replace(bench.machine, model=mujoco.MjModel.from_xml_string(text))


def test_the_forms_of_a_model(bench) -> None:
    made = Numerics.of(machine(bench, "Euler", 0.001), 1)
    assert (made.given.model.opt.integrator, made.given.substeps) == (EULER, 10)
    assert (made.fine.model.opt.integrator, made.fine.substeps) == (RK4, 10)
    assert (made.middle.model.opt.integrator, made.middle.substeps) == (RK4, 2)
    assert (made.coarse.model.opt.integrator, made.coarse.substeps) == (EULER, 2)
    assert made.late is not None
    assert (made.late.late, made.late.substeps) == (True, 2)
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
