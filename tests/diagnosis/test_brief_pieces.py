from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.brief_pieces import begun, brief, closest, left, seconds_of
from torch_activegp.diagnosis.machine import make_machine
from torch_activegp.diagnosis.noise_model import NoiseModel
from torch_activegp.diagnosis.numerics import Numerics
from torch_activegp.diagnosis.segments import cut
from torch_activegp.diagnosis.shooting import Shooting

NOISE = 5e-5
XML = """
<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody>
<geom type="plane" pos="0.2 0 0" zaxis="-1 0 0" size="1 1 .1" condim="1" solref="0.02 0.3"/>
<body name="ram"><joint name="x" type="slide" axis="1 0 0" stiffness="40" damping="0.4"/>
<geom type="sphere" size="0.05" mass="1" condim="1" solref="0.02 0.3"/></body></worldbody>
<actuator><motor name="coil" joint="x"/></actuator></mujoco>"""


def ram(parts: int):
    """A ram that leans on a wall half of the time, simulated in so many parts of its model's steps."""
    model = mujoco.MjModel.from_xml_string(XML)
    truth = mujoco.MjModel.from_xml_string(XML.replace('timestep="0.01"', f'timestep="{0.01 / parts}"'))
    data, rng = mujoco.MjData(truth), np.random.default_rng(0)
    time = np.arange(801) / 100
    control = 6.0 + 9.0 * np.sin(2 * np.pi * 1.1 * time)
    position = []
    for force in control:
        position.append(data.qpos[0])
        data.ctrl[:] = force
        mujoco.mj_step(truth, data, parts)
    columns = {"time": time, "qpos.x": np.array(position) + NOISE * rng.normal(size=801), "ctrl.coil": control}
    assert max(position) > 0.15
    recording = Recording.from_columns("strikes", columns)
    return make_machine(model, [recording], [recording])


@pytest.fixture(scope="module")
def finer():
    return ram(5)


NOISES = NoiseModel.white(np.array([NOISE]))


@pytest.mark.parametrize("parts", [1, 5])
def test_the_form_that_made_the_recordings_is_closest_where_something_touches(parts) -> None:
    machine = ram(parts)
    forms = Numerics.of(machine, 1)
    assert forms.stiff
    found = closest(forms, machine, NOISES)
    assert found.substeps in {1: {1}, 5: {4, 5}}[parts]  # the cheapest of those that are close
    assert found is forms.coarse or found in forms.own


def test_rows_far_apart_say_nothing_of_the_form(finer) -> None:
    forms = Numerics.of(finer, 1)
    slow = dataclasses.replace(finer, fit=[dataclasses.replace(run, time=2.0 * run.time) for run in finer.fit])
    assert seconds_of(slow.fit) == pytest.approx(0.24)
    assert brief(slow.fit) is None
    assert closest(forms, slow, NOISES) is forms.coarse


def test_segments_begin_where_brief_pieces_lead_across_impacts(finer) -> None:
    forms = Numerics.of(finer, 1)
    form = next(form for form in forms.own if form.substeps == 5)
    shooting = Shooting(form, cut(finer.fit, 1.0, 0.0), NOISES)
    smooth, fitted = (
        shooting.fit([((), ())], starts, rounds=2)[0] for starts in (form.starts(shooting.segments), begun(shooting))
    )
    assert fitted.chi2 < 2.0 * shooting.dof
    assert smooth.chi2 > 5.0 * fitted.chi2


def test_a_piece_across_an_impact_does_not_decide_between_forms(finer) -> None:
    forms = Numerics.of(finer, 1)
    shooting = Shooting(forms.given, cut(finer.fit, 0.25, 0.0), NOISES)
    run = finer.fit[0]
    first = int(shooting.segments.first[3])
    moved = run.position.copy()
    moved[first : first + 12] += 0.1 * np.sin(np.arange(12))[:, None]
    spoiled = dataclasses.replace(shooting.segments, runs=(dataclasses.replace(run, position=moved),))
    one, other = (left(shooting, forms.own[-1]), left(dataclasses.replace(shooting, segments=spoiled), forms.own[-1]))
    assert other == pytest.approx(one, rel=0.1)
    assert left(shooting, forms.given) > 2.0 * one


def test_effects_are_held_while_forms_are_compared(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    bare, behind = left(bench.shooting, bench.engine), left(bench.shooting, bench.engine, fit)
    assert behind < bare
    wrong = dataclasses.replace(fit, values=(np.array([5.0]),))
    assert left(bench.shooting, bench.engine, wrong) > 2.0 * bare
