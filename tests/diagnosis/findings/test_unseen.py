from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.findings.forecast import FAILED
from torch_activegp.diagnosis.findings.unseen import foreseeable, is_predictable, marked, refutation, taken_back
from torch_activegp.diagnosis.findings.verdict import decide
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine

DOUBLE = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody>
<body><joint name="upper" axis="0 1 0"/><inertial pos="0 0 -0.5" mass="1" diaginertia="0.02 0.02 0.001"/>
<body pos="0 0 -1"><joint name="lower" axis="0 1 0"/><inertial pos="0 0 -0.5" mass="1" diaginertia="0.02 0.02 0.001"/>
</body></body></worldbody></mujoco>"""


def said(before: float, after: float, step: tuple[float, float] = (2.0, 1.0), joint: str = "hip") -> list[dict]:
    """Held-out errors of one run, in units of noise that is a thousandth of the motion."""
    pairs = [[FAILED if error >= FAILED else 1e-3 * error for error in pair] for pair in ((before, after), step)]
    free, one = ({"before": first, "after": last, "noise": 1e-3} for first, last in pairs)
    return [{"run": "kept", "channel": f"qpos.{joint}", "free_run": free, "one_step": one}]


@pytest.mark.parametrize(
    ("before", "after", "lost"),
    [(30.0, 4.9, False), (30.0, 9.0, True), (4.0, 6.0, True), (900.0, 40.0, False)],  # the last: a quiet encoder
)
def test_what_leaves_much_more_than_noise_and_is_little_better_is_refuted(before, after, lost: bool) -> None:
    why = refutation(said(before, after))
    assert (why is not None) is lost
    assert why is None or "times the noise" in why


@pytest.mark.parametrize(("after", "lost"), [(240.0, False), (260.0, True)])
def test_what_is_far_off_the_motion_itself_is_lost_however_far_off_the_simulator_was(after: float, lost: bool) -> None:
    """A servo's command in degrees, read in rad, put a machine 35 times its motion away, and wrong names 0.3."""
    assert (refutation(said(35e3, after)) is not None) is lost


@pytest.mark.parametrize("before", [900.0, 1600.0, 1700.0, 35e3])
def test_what_sees_well_ahead_is_excused_however_far_off_the_simulator_was(before: float) -> None:
    assert refutation(said(before, 400.0, (500.0, 10.0))) is None
    assert refutation(said(before, 520.0, (500.0, 10.0))) is not None


@pytest.mark.parametrize(
    ("free", "step", "lost"),
    [
        ((30.0, 9.0), (40.0, 10.0), False),
        ((30.0, 9.0), (40.0, 11.0), True),
        ((30.0, 16.0), (40.0, 9.0), True),
        ((4.0, 6.0), (40.0, 9.0), True),
        ((30.0, 9.0), (1e9, 9.0), True),  # a simulation that failed without them
    ],
)
def test_a_free_run_that_is_lost_refutes_no_names_that_see_well_ahead(free, step, lost: bool) -> None:
    """What nothing holds goes far by little, in a while. Names with which it is worse are refuted all the same."""
    held_out = said(*free, step)
    assert (refutation(held_out) is not None) is lost
    other = said(20.0, 9.0, (9.0, 8.0), "knee")  # a joint that does not speaks against them
    assert refutation([*held_out, *other]) is not None


@pytest.mark.parametrize(
    ("before", "after", "lost"),
    [(3.0, 3.2, True), (3.0, 3.0, False), (1.7, 1.9, False), (1100.0, 1300.0, False)],
)
def test_one_run_that_is_forecast_worse_than_without_names_refutes_them(before, after, lost: bool) -> None:
    """Though all together are forecast better; not near the noise, nor where a simulator is farther off than a mean."""
    better = [{**entry, "run": "other"} for entry in said(20.0 * before, min(4.0 * before, 900.0))]
    other = [{**entry, "run": "third"} for entry in said(30.0 * before, 2.0)]
    why = refutation([*said(before, after), *better, *other], lambda: 1.0 if before > 99.0 else 0.0)
    assert (why is not None) is lost
    assert why is None or why.startswith("not kept")
    seen = said(before, after, (40.0, 9.0))
    assert refutation([*seen, *better, *other], lambda: 1.0 if before > 99.0 else 0.0) == why  # one step is no excuse
    still = {"before": 1.5, "after": 1.0, "noise": 1.0}
    asleep = [{**seen[0], "channel": "qpos.knee", "free_run": still}]
    assert refutation([*said(before, after), *asleep, *better, *other]) == why  # errors of it are no part of a motion
    assert refutation([*said(before, after), *better, *other], lambda: 0.001 * after) is None  # nor told by chance


@pytest.mark.parametrize(
    ("step", "lost"),
    [((0.93, 1.36), True), ((1.21, 1.33), False), ((3.3, 3.5), False), ((0.9, 1.15), False), ((2.0, 1.0), False)],
)
def test_uncertain_parameters_excuse_no_run_that_is_forecast_worse_by_one_step_too(step, lost: bool) -> None:
    better = [{**entry, "run": "other"} for entry in said(28.0, 4.9)]
    why = refutation([*said(1.1, 7.8, step), *better], lambda: 9e-3)
    assert (why is not None) is lost
    assert why is None or why.startswith("not kept")


@pytest.mark.parametrize(
    ("before", "expected", "lost"),
    [(30.0, 0.0, True), (30.0, 1.4, True), (30.0, 1.6, False), (12.1, 1.6, False), (11.9, 1.6, True)],
)
def test_a_free_run_that_uncertain_parameters_would_lose_too_refutes_no_names(before, expected, lost: bool) -> None:
    """Where they leave clearly less than there was."""
    assert (refutation(said(before, 9.0), lambda: 1e-3 * expected) is not None) is lost


def test_nobody_asks_how_uncertain_free_runs_are_that_are_near() -> None:
    assert refutation(said(30.0, 4.9), pytest.fail) is None


@pytest.mark.parametrize(
    ("free", "step", "worse"),
    [
        ((2.0, 2.5), (2.0, 1.0), "free runs"),
        ((2.0, 1.4), (1.3, 1.4), "forecasts by one step"),
        ((2.0, 1.3), (1.3, 1.4), None),  # half the way to the noise, beyond it
        ((8.0, 4.2), (1.3, 1.4), "forecasts by one step"),
        ((8.0, 4.0), (1.3, 1.4), None),
        ((0.9, 0.9), (1.3, 1.4), "forecasts by one step"),  # there without the names
        ((1e9, 3.0), (1.3, 1.4), "forecasts by one step"),  # from a simulation that failed
        ((2.0, 1.0), (1.0, 1.1), None),  # about the noise
        ((2.0, 2.04), (1.3, 1.32), None),  # about the same
    ],
)
def test_names_with_which_forecasts_are_worse_than_without_are_refuted(free, step, worse) -> None:
    why = refutation(said(*free, step))
    assert (why is None) is (worse is None)
    assert why is None or (worse in why and "without" in why)


def test_a_joint_that_reaches_the_noise_is_no_excuse_for_one_that_gets_worse() -> None:
    hip, knee = (
        said(*free, step, joint)
        for free, step, joint in (((30.0, 1.0), (1.3, 1.3), "hip"), ((1.0, 1.35), (1.3, 2.5), "knee"))
    )
    why = refutation([*hip, *knee])
    assert why is not None
    assert "one step" in why


def test_a_run_in_which_a_small_change_grows_is_not_predictable() -> None:
    """A double pendulum that turns over doubles an error of its initial state twice a second.

    Its forecast may have left the recording for where it is calm, or the other way round.
    """
    model = mujoco.MjModel.from_xml_string(DOUBLE)
    time = np.arange(1001) / 100

    def recorded(upper: float) -> Machine:
        columns = {"time": time, "qpos.upper": upper + 0.1 * np.sin(time), "qpos.lower": 0.1 * np.sin(time)}
        return make_machine(model, [Recording.from_columns("still", columns)], [])

    low, high = (recorded(upper).fit[0] for upper in (0.1, 2.5))
    engine = Engine(model, substeps=5, channels=recorded(0.1).channels)
    wild, calm = [2.5, 0.1, 0.0, 0.0], [0.1, 0.1, 0.0, 0.0]
    for runs, starts, tells in (([low], [calm], True), ([low], [wild], False), ([high], [calm], False)):
        assert is_predictable(engine, NOMINAL, runs, starts).tolist() == [tells]
    assert is_predictable(engine, NOMINAL, [high, low], np.array([calm, calm])).tolist() == [False, True]


@pytest.mark.parametrize(("stiffness", "asked"), [(10.0, [2]), (1e6, [2, 20])])
def test_changes_that_grow_in_long_time_steps_are_looked_at_in_short_ones(stiffness, asked, monkeypatch) -> None:
    """Of a spring that Runge-Kutta lets fly apart in steps of 5 ms and follows in 0.5 ms."""
    spring = f"""<mujoco><worldbody><body><joint name="reed" type="slide" stiffness="{stiffness}" damping="10"/>
      <geom type="sphere" size="0.1" mass="1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(spring)
    time = np.arange(201) / 100
    columns = {"time": time, "qpos.reed": 1e-3 * np.sin(time)}
    machine = make_machine(model, [Recording.from_columns("still", columns)], [])
    engine = Engine(model, substeps=20, channels=machine.channels, integrator=int(mujoco.mjtIntegrator.mjINT_RK4))
    simulated, plain = [], Engine.predict
    monkeypatch.setattr(Engine, "predict", lambda self, *args: simulated.append(self.substeps) or plain(self, *args))
    assert is_predictable(engine, NOMINAL, machine.fit, [[0.0, 0.0]]).tolist() == [True]
    assert simulated == asked


def test_a_run_that_nothing_forecasts_refutes_nothing_and_a_note_says_so(bench) -> None:
    """Of runs with one name too."""
    (kept,) = bench.machine.holdout
    runs = [kept, dataclasses.replace(kept, label="wild")]
    held_out = {"runs": [*said(30.0, 1.0), *said(30.0, 20.0)], "free_run": {}}
    found, notes = marked(held_out, runs, [True, False])
    assert (found["free_run"], [entry["predictable"] for entry in found["runs"]]) == ({}, [True, False])
    assert refutation(foreseeable(found)) is None
    (note,) = notes
    assert note.startswith("wild: by the simulator a small change of the state grows more than a hundredfold")
    found, notes = marked(held_out, runs, [True, True])
    assert notes == []
    assert refutation(foreseeable(found)) is not None


def test_without_its_names_a_verdict_is_unknown_and_says_why(bench) -> None:
    fits = [bench.nominal, bench.fit("viscous_friction", 0.05)]
    verdict = decide(
        bench.shooting, Selection(bench.nominal, fits, Score(bench.shooting.samples, 60, 1.0)), bench.effects
    )
    judgement, stable, notes, *_ = taken_back(verdict, "not the held-out ones: free runs are off")
    assert (judgement.verdict, judgement.named, judgement.unexplained, stable) == ("unknown", (), 1.0, None)
    assert notes[-1].startswith("viscous_friction at joint:hip would explain these recordings best, but not the held-")
    assert "free runs are off" in notes[-1]


def test_names_that_do_not_hold_for_other_runs_are_not_given(bench, record) -> None:
    """The held-out run was recorded from another machine: its motor pushes the other way half of the time."""
    runs, other = [record("viscous", seed) for seed in range(3)], record("viscous", 9, "kept")
    control = other["ctrl.drive"].numpy().copy()
    control[len(control) // 2 :] *= -1.0
    strange = record("viscous", 9, "kept", ctrl__drive=control)
    found, good = (diagnose(bench.xml, runs, [kept], nthread=1) for kept in (strange, other))
    assert (good.verdict, found.verdict) == ("named", "unknown")
    assert found.effects == ()
    assert found.stability is None
    assert any("explain these recordings best, but not the held-out ones" in note for note in found.details["notes"])
    assert found.details["fit"]["holdout"]["free_run"]["after"] == found.details["fit"]["holdout"]["free_run"]["before"]
    assert dataclasses.asdict(good.effects[0])["name"] == "viscous_friction"
