from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Self

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.data.balls import balls_model, load_balls
from torch_activegp.diagnosis import diagnose, evaluate
from torch_activegp.diagnosis.diagnose import _forecasts, _remainder
from torch_activegp.diagnosis.findings.remainder import Outcome, model_remainder
from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.physics import Parameter, Place
from torch_activegp.physics.friction import write_sharp
from torch_activegp.physics.joint import JointEffect
from torch_activegp.report import write_report


def test_viscous_friction_is_named_with_its_coefficient(bench, diagnosed) -> None:
    found = diagnosed("viscous")
    (effect,) = found.effects
    assert (found.verdict, effect.name, effect.target) == ("named", "viscous_friction", "joint:hip")
    estimate = effect.parameters["coefficient"]
    assert estimate.value == pytest.approx(bench.viscous, rel=0.05)
    assert estimate.ci95[0] < bench.viscous < estimate.ci95[1]
    assert effect.share == pytest.approx(1.0, abs=0.05)
    assert effect.mjcf
    assert not any("MJCF cannot hold" in note for note in found.details["notes"])
    assert "viscous_friction at joint:hip" in found.sentence
    assert found.details["mismatch"]["noise"]["qpos.hip"] == pytest.approx(bench.noise, rel=0.15)


def test_nothing_is_named_where_nothing_was_left_out(diagnosed) -> None:
    found = diagnosed("none")
    assert (found.verdict, found.effects, found.details["next_experiment"]) == ("none", (), None)
    assert found.details["mismatch"]["detected"] is False
    assert found.details["mismatch"]["p_value"] > 0.001
    assert "next.csv" not in found.files


def test_a_servo_that_is_too_weak_is_named_with_the_limit_of_its_force(servo) -> None:
    runs = [servo.record(3.5, seed) for seed in range(5)]
    found = diagnose(servo.xml, runs[:4], runs[4:])
    (effect,) = found.effects
    assert (found.verdict, effect.name, effect.target) == ("named", "actuator_saturation", "actuator:drive")
    assert effect.parameters["limit"].value == pytest.approx(3.5, rel=0.02)
    assert "3.5 N m" in found.sentence
    model = mujoco.MjModel.from_xml_string(found.files["corrected.xml"])
    limit = effect.parameters["limit"].value
    np.testing.assert_allclose(model.actuator_forcerange[0], [-limit, limit], rtol=1e-5)
    errors = found.details["fit"]["holdout"]["free_run"]
    assert errors["after"] < 1.3 * errors["noise"] < 0.3 * errors["before"]


@pytest.mark.parametrize("path", ["runs/*.csv", Path("run.csv")])
def test_a_path_in_place_of_recordings_is_refused(bench, path: str | Path) -> None:
    with pytest.raises(ConfigurationError, match=r"found a path. Read it: load_recordings\('run"):
        diagnose(bench.xml, path)
    with pytest.raises(ConfigurationError, match=r"found a path. Read it: load_recordings\('run"):
        diagnose(bench.xml, [path])
    with pytest.raises(ConfigurationError, match=r"evaluate: recordings wanted, found a path"):
        evaluate(bench.xml, path)
    with pytest.raises(ConfigurationError, match="diagnose: recordings wanted, found 3"):
        diagnose(bench.xml, [3])


def test_a_bump_over_the_position_is_unknown(diagnosed) -> None:
    found = diagnosed("bump")
    assert (found.verdict, found.effects) == ("unknown", ())
    assert found.details["unexplained"]["white"] is False
    assert "no effect on the list explains it" in found.sentence


class Bump(JointEffect):
    """The torque that :func:`test_a_bump_over_the_position_is_unknown` has no name for."""

    name = "bump"
    law = "A exp(-((q - p)/w)^2)"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        parameters = (
            Parameter("height", place.force_unit, 0.1 * place.force),
            Parameter("place", place.position_unit, 0.02, *place.position),
            Parameter("width", place.position_unit, 0.01, 0.02, 1.0),
        )
        seeds = [[place.force, p, 0.1] for p in np.linspace(*place.position, 12)]
        return cls.make(place, parameters, seeds, linear=1)

    def force(self, position, velocity, values):
        return values[0] * np.exp(-(((position - values[1]) / values[2]) ** 2))


def test_what_is_left_of_a_single_segment_is_not_learned(bench) -> None:
    """Nothing could be kept from the training of a Gaussian process."""
    one = np.array([0])
    explanation = SimpleNamespace(shooting=bench.shooting.pick(one), engine=bench.engine)
    judgement = SimpleNamespace(verdict="unknown", white=False, unexplained=1.0)
    assert _remainder(explanation, judgement, bench.nominal.pick(one)) is None


@pytest.mark.parametrize("factor", [1.0, -3.0])
def test_a_learned_force_that_misleads_on_held_out_runs_is_not_handed_out(bench, factor: float) -> None:
    found = model_remainder(bench.shooting, bench.nominal, ("qpos.hip", "qvel.hip", "ctrl.drive"))
    effect = dataclasses.replace(found.effect, weights=factor * found.effect.weights)
    outcome, holdout, (trace, *_) = _forecasts(
        bench.machine, bench.shooting, bench.engine, bench.nominal, Outcome(effect, found.details)
    )
    helps, said = factor == 1.0, outcome.notes
    assert len(said) == (not helps)
    assert helps or "not those of the held-out runs (one step " in said[0]
    assert (outcome.effect is effect, outcome.details["used"]) == (helps, helps)
    assert ("gp" in holdout["free_run"], trace["gp"] is not None) == (helps, helps)


@pytest.mark.parametrize("ball", ["baseball", "golf_ball", "bowling_ball"])
def test_no_drag_is_named_on_a_heavy_ball(recordings_dir, ball: str) -> None:
    """Its video errs by a tenth of a metre for half a second; one segment, chi2 of free fall about one."""
    found = diagnose(balls_model(), [load_balls(ball, 1)], [load_balls(ball, 2)], nthread=1)
    assert found.verdict == "none"
    assert found.details["mismatch"]["chi2_per_dof"] < 1.5


def test_drag_is_named_on_a_light_ball(recordings_dir) -> None:
    """Video of two seconds cannot tell it from a drag of two levels, nor from a spring."""
    found = diagnose(balls_model(), [load_balls("whiffle_ball_1", 1)], [load_balls("whiffle_ball_1", 2)], nthread=1)
    assert [effect.name for effect in found.effects] == ["viscous_friction"]
    assert found.effects[0].parameters["coefficient"].value == pytest.approx(0.525, rel=0.1)


def test_a_law_of_the_users_is_named_beside_the_list(bench, record) -> None:
    recordings = [record("bump", i, f"run{i}") for i in range(3)]
    found = diagnose(bench.xml, recordings, [record("bump", 9, "kept")], effects=[Bump], nthread=1)
    (effect,) = found.effects
    assert (found.verdict, effect.name, effect.target, effect.mjcf) == ("named", "bump", "joint:hip", False)
    assert effect.parameters["height"].value == pytest.approx(0.8, rel=0.1)
    assert effect.parameters["place"].value == pytest.approx(0.4, abs=0.01)
    assert "A exp(-((q - p)/w)^2)" in effect.law
    assert any("MJCF cannot hold bump at joint:hip here" in note for note in found.details["notes"])
    assert "corrected.pt" in found.files
    assert (
        found.details["fit"]["holdout"]["free_run"]["after"]
        < 0.2 * found.details["fit"]["holdout"]["free_run"]["before"]
    )


def test_the_corrected_model_reproduces_the_held_out_error_in_plain_mujoco(record, diagnosed) -> None:
    found = diagnosed("viscous")
    model = mujoco.MjModel.from_xml_string(found.files["corrected.xml"])
    (trace,) = found.evidence["traces"]
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = trace["start_after"]
    substeps = round(0.01 / model.opt.timestep)
    seen = []
    for u in record("viscous", 9)["ctrl.drive"].tolist():
        seen.append(data.qpos[0])
        data.ctrl[:] = u
        mujoco.mj_step(model, data, substeps)
    measured = np.array(trace["measured"])
    error = np.sqrt(np.mean((np.array(seen) - measured) ** 2)) / measured.std()
    assert error == pytest.approx(found.details["fit"]["holdout"]["free_run"]["after"], rel=0.02)
    assert error < 0.3 * found.details["fit"]["holdout"]["free_run"]["before"]


def test_the_corrected_model_sticks_where_the_machine_does(bench, record) -> None:
    """The model lets its own friction creep, the machine does not, and has more damping."""
    nominal = bench.xml.replace('name="hip"', 'name="hip" frictionloss="0.6"', 1)
    spec = mujoco.MjSpec.from_string(nominal.replace('"0.005"', '"0.001"'))
    write_sharp(spec.joint("hip"), 0.001)
    spec.joint("hip").damping[0] = 0.1
    truth = spec.compile()

    def angles(model: mujoco.MjModel, control: np.ndarray) -> np.ndarray:
        data, seen = mujoco.MjData(model), []
        for u in control:
            seen.append(data.qpos[0])
            data.ctrl[:] = u
            mujoco.mj_step(model, data, round(0.01 / model.opt.timestep))
        return np.array(seen)

    runs, rng = [], np.random.default_rng(1)
    for seed in range(3):
        control = 2.0 * np.asarray(record("none", seed)["ctrl.drive"])
        noisy = angles(truth, control) + 2e-4 * rng.normal(size=len(control))
        runs.append(record("none", seed, name=f"run{seed}", qpos__hip=noisy, ctrl__drive=control))
    found = diagnose(nominal, runs[:2], runs[2:])
    assert [effect.name for effect in found.effects] == ["viscous_friction"]
    assert any("sticks firmly" in note for note in found.details["notes"])
    corrected = mujoco.MjModel.from_xml_string(found.files["corrected.xml"])
    assert np.abs(angles(corrected, control) - angles(truth, control)).max() < 2e-3
    hold = np.full(200, 0.4)
    assert np.abs(angles(corrected, hold)).max() < 3e-4 < np.abs(angles(bench.machine.model, hold)).max()


@pytest.mark.parametrize("level", [0.0, 0.05])
def test_runs_may_differ_in_rate(bench, level: float) -> None:
    """A model is none the worse for a slower run beside a faster one, and what is missing has its value."""

    def swing(seed: int, steps: int) -> Recording:
        model = mujoco.MjModel.from_xml_string(bench.xml)
        model.dof_frictionloss[0] = level
        data, rng = mujoco.MjData(model), np.random.default_rng(seed)
        time = np.arange(0, 3.0, steps * model.opt.timestep)
        control, angle = 0.5 * np.sin(3.0 * time + seed) + 0.4 * np.sign(np.sin(5.0 * time)), []
        for u in control:
            angle.append(data.qpos[0])
            data.ctrl[:] = u
            mujoco.mj_step(model, data, steps)
        read = np.array(angle) + 5e-4 * rng.normal(size=len(time))
        return Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": read, "ctrl.drive": control})

    fast, slow, between = (swing(seed, steps) for seed, steps in enumerate((1, 10, 4)))
    found = diagnose(bench.xml, [fast, slow], [between], nthread=1)
    assert [effect.name for effect in found.effects] == ["coulomb_friction"] * bool(level)
    for effect in found.effects:
        assert effect.parameters["level"].value == pytest.approx(level, rel=0.03)
    errors = found.details["fit"]["holdout"]["free_run"]
    assert errors["after"] < 1.2 * errors["noise"]
    rates = [round(entry["rate_hz"], 3) for entry in found.details["recordings"]]
    assert rates == [200.0, 20.0, 50.0]


def test_two_calls_give_equal_dictionaries(bench, record, diagnosed) -> None:
    stages: list[str] = []
    shares: list[float] = []
    again = diagnose(
        bench.xml,
        [record("viscous", i, f"run{i}") for i in range(3)],
        [record("viscous", 9, "kept")],
        nthread=1,
        tell=lambda words, done: stages.append(words) or shares.append(done),
    )
    first = diagnosed("viscous")
    assert again.to_dict() == first.to_dict()
    assert json.dumps(again.evidence) == json.dumps(first.evidence)
    assert again.files == first.files
    assert stages[0] == "reading" and "forecasting held-out runs" in stages
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == 0.99


def test_the_result_is_json_and_names_its_recordings(diagnosed, tmp_path) -> None:
    found = diagnosed("viscous")
    found.save(tmp_path)
    read = json.loads((tmp_path / "diagnosis.json").read_text())
    assert [(entry["name"], entry["role"]) for entry in read["recordings"]] == [
        ("run0", "fit"),
        ("run1", "fit"),
        ("run2", "fit"),
        ("kept", "holdout"),
    ]
    assert read["recordings"][0]["rate_hz"] == pytest.approx(100.0)
    assert read["model"] == {"name": "MJCF text", "source": "MJCF text"}
    assert 'damping="' in read["mjcf_diff"]


def test_what_cannot_be_diagnosed_is_refused(bench, record) -> None:
    with pytest.raises(DataError, match="no recording to fit"):
        diagnose(bench.xml, [])
    with pytest.raises(DataError, match=r"the model has no joint `knee`; its joints are hip"):
        diagnose(bench.xml, [record(qpos__knee=np.linspace(0.0, 1.0, 201))])
    with pytest.raises(ConfigurationError, match="no file `missing.xml`"):
        diagnose("missing.xml", [record()])


def test_what_a_prescribed_joint_carries_is_explained(double, tmp_path) -> None:
    """A rig moves the shoulder with a torque that nobody recorded; friction of the elbow is found beside it."""
    recordings = [double.record(seed, double.viscous, noise=double.noise) for seed in range(3)]
    found = diagnose(double.model(), recordings[:2], recordings[2:], nthread=1)
    (effect,) = found.effects
    assert (found.verdict, effect.name, effect.target) == ("named", "viscous_friction", "joint:elbow")
    estimate = effect.parameters["coefficient"]
    assert estimate.value == pytest.approx(double.viscous, rel=0.03)
    assert estimate.ci95[0] < double.viscous < estimate.ci95[1]
    assert list(found.details["mismatch"]["noise"]) == ["qpos.elbow"]
    after = found.details["fit"]["holdout"]["free_run"]
    assert after["after"] < 3 * after["noise"] < 0.1 * after["before"]
    assert [trace["channel"] for trace in found.evidence["traces"]] == ["qpos.elbow"]
    page = write_report(found.to_dict(), found.evidence, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Prescribed: shoulder." in page


def test_nothing_is_named_beside_a_prescribed_joint_where_nothing_was_left_out(double) -> None:
    recordings = [double.record(seed, noise=double.noise) for seed in range(3)]
    found = diagnose(double.model(), recordings[:2], recordings[2:], nthread=1)
    assert (found.verdict, found.effects) == ("none", ())


def test_what_was_decided_about_the_recordings_is_said_before_anything_is_computed(bench, record, caplog) -> None:
    def stop(words: str, done: float | None) -> None:
        if words == "noise floor":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(bench.xml, [record(), record(), record()], tell=stop)
    assert "No held-out runs given: set aside" in caplog.text
