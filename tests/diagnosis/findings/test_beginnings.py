from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.findings import beginnings
from torch_activegp.diagnosis.findings.beginnings import Beginnings, along_lines, left_by
from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.inputs.held_out import PAD
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine


@pytest.fixture(scope="module")
def truth(bench) -> Candidate:
    return Candidate((bench.effect("viscous_friction"),), (np.array([bench.viscous]),))


@pytest.mark.parametrize(("damping", "substeps"), [(0.1, 2), (1.0, 8), (4.0, 40)])
def test_initial_states_are_fitted_in_longer_steps_where_these_do(damping: float, substeps: int, monkeypatch) -> None:
    """Runge-Kutta of a stiff joint diverges in them: in 5 ms, and in 1.25 ms; there the engine itself fits."""
    xml = f"""<mujoco><option timestep="0.00025" integrator="RK4"/><worldbody><body>
    <joint name="x" damping="{damping}"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
    </body></worldbody>
    <actuator><motor name="m" joint="x"/></actuator></mujoco>"""
    model, rng = mujoco.MjModel.from_xml_string(xml), np.random.default_rng(0)
    data, positions, time = mujoco.MjData(model), [], np.arange(401) / 100
    control = damping * np.sin(7.0 * time)
    for force in control:
        positions.append(data.qpos[0])
        data.ctrl[:] = force
        mujoco.mj_step(model, data, 40)
    columns = {"time": time, "qpos.x": np.array(positions) + 1e-3 * rng.normal(size=401), "ctrl.m": control}
    machine = make_machine(model, [recording := Recording.from_columns("run", columns)], [recording])
    engine, noise = Engine(machine.model, machine.channels, 40, 1), NoiseModel.white(np.array([1e-3]))
    used, fit = set(), Shooting.fit
    monkeypatch.setattr(Shooting, "fit", lambda self, *a, **k: used.add(self.engine.substeps) or fit(self, *a, **k))
    overall, _ = compare({"before": (engine, NOMINAL)}, machine.fit, ["x"], noise)
    for kind in ("one_step", "free_run"):
        assert overall[kind]["before"] < 1.3 * overall[kind]["noise"]
    assert max(used) == substeps


def test_steps_that_misled_about_a_model_are_not_tried_with_it_again(bench, truth, monkeypatch) -> None:
    fine = Engine(bench.machine.model, bench.engine.channels, 8, 1, int(mujoco.mjtIntegrator.mjINT_RK4))
    begin = Beginnings(fine, bench.shooting.noise, [NOMINAL, truth], 0.005)
    whole = cut(bench.machine.holdout, 1e9, 0.0)
    asked: list[tuple[int, int]] = []
    fit = Shooting.fit
    monkeypatch.setattr(
        Shooting,
        "fit",
        lambda self, sets, *a, **k: asked.append((self.engine.substeps, len(sets))) or fit(self, sets, *a, **k),
    )
    monkeypatch.setattr(
        beginnings, "_agrees", lambda _, fits: np.array([bool(one.effects) for one in fits])
    )  # the nominal is misled
    first = begin.fit(whole, fine.starts(whole))
    assert asked == [(1, 2), (4, 1), (8, 1)]
    assert first.shape == (2, whole.size, 2)
    asked.clear()
    again = begin.fit(whole, first)
    assert asked == [(1, 1), (8, 1)]
    np.testing.assert_allclose(again[0], first[0], atol=1e-3)
    asked.clear()
    begin.of(np.array([0])).fit(whole, fine.starts(whole))
    assert asked == [(8, 1)]
    compared, predict = [], Engine.predict
    monkeypatch.setattr(
        Engine, "predict", lambda self, *args: compared.append((self.substeps, len(args[2]))) or predict(self, *args)
    )
    np.testing.assert_array_equal(begin.better(whole, first, first + 0.3), first)
    assert compared == [(4, 2), (8, 2)]  # both guesses of each


@pytest.mark.parametrize("lost", [False, True])
def test_a_first_speed_that_was_smoothed_wrongly_is_not_the_guess(bench, truth, lost: bool) -> None:
    """By a coarse clock the smoothed recording begins at any speed: a line through the first recorded rows is tried."""
    run, whole = bench.machine.holdout[0], cut([bench.machine.holdout[0]], 1e9, PAD)
    begin = Beginnings(bench.engine, bench.shooting.noise, [NOMINAL, truth], 0.01)
    recorded, position = np.ones(len(run), dtype=bool), run.position.copy()
    if lost:  # rows of which nothing is known are on no line
        recorded[1:3], position[1:3] = False, position[1:3] + 100.0
    wrong = dataclasses.replace(run, position=position, recorded=recorded, velocity=run.velocity + 300.0)
    right = bench.engine.starts(whole)
    found = begin.guess(cut([wrong], 1e9, PAD))
    assert found.shape == (2, 1, 2)
    after = np.arange(len(run)) >= 5  # which a forecast of them must not see
    unseen = dataclasses.replace(wrong, position=np.where(after[:, None], 50.0, position))
    head = dataclasses.replace(cut([unseen], 1e9, PAD), counts=~after[None])
    along = along_lines(bench.engine, head, bench.engine.starts(head))
    np.testing.assert_allclose(along[0], right[0], atol=0.5)
    np.testing.assert_allclose(found[..., 1], right[0, 1], atol=0.5)
    np.testing.assert_allclose(found[..., 0], right[0, 0], atol=0.05)
    shooting = Shooting(bench.engine, whole, bench.shooting.noise)
    both = [
        left_by(shooting, bench.engine.predict(whole, some, [NOMINAL, truth]))
        for some in (begin.guess(whole), np.stack([right] * 2))
    ]
    assert (both[0] <= both[1]).all()


@pytest.mark.parametrize(("damping", "asked"), [(1.0, [4]), (4.0, [4, 20])])
def test_guesses_are_compared_in_longer_steps_where_these_lead_anywhere(damping: float, asked, monkeypatch) -> None:
    """A joint whose damping lets Runge-Kutta fly apart in steps of 1.25 ms is compared in its own of 0.25 ms."""
    xml = f"""<mujoco><option timestep="0.00025" integrator="RK4"/><worldbody><body>
    <joint name="x" damping="{damping}"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
    </body></worldbody></mujoco>"""
    model, time = mujoco.MjModel.from_xml_string(xml), np.arange(101) / 200
    still = Recording.from_columns("still", {"time": time, "qpos.x": 1e-6 * time})
    machine = make_machine(model, [still], [])
    engine, whole = Engine(machine.model, machine.channels, 20, 1), cut(machine.fit, 1e9, 0.0)
    begin = Beginnings(engine, NoiseModel.white(np.array([1e-3])), [NOMINAL], 0.005)
    simulated, predict = [], Engine.predict
    monkeypatch.setattr(Engine, "predict", lambda self, *args: simulated.append(self.substeps) or predict(self, *args))
    rest, moving = np.full((1, whole.size, 2), 1e-3), np.full((1, whole.size, 2), 1.0)
    np.testing.assert_array_equal(begin.better(whole, moving, rest), rest)
    np.testing.assert_array_equal(begin.better(whole, rest, moving), rest)
    assert simulated == asked * 2
