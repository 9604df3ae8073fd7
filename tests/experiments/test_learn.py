from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.experiments import learn as module
from torch_activegp.experiments.learn import Learned, learn
from torch_activegp.experiments.recorded import load_named
from torch_activegp.simulators import MujocoSimulator


@pytest.fixture(scope="module")
def slide_outcome(slide_run, tmp_path_factory) -> Learned:
    path = tmp_path_factory.mktemp("learn") / "slide.xml"
    path.write_text(SLIDE)
    return learn(str(path), [slide_run("a", seed=1), slide_run("b", seed=2)], [slide_run("c", seed=3)])


SLIDE = """
<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body></worldbody>
<actuator><motor name="push" joint="slide"/></actuator></mujoco>"""


def test_friction_is_learned_from_noisy_positions(slide_outcome: Learned) -> None:
    before, after = slide_outcome.before, slide_outcome.after
    assert after.one_step.rmse["qvel.slide"] < before.one_step.rmse["qvel.slide"] / 4
    assert after.window.position_nrmse < before.window.position_nrmse / 5
    assert after.free_run.position_nrmse < before.free_run.position_nrmse / 10
    assert not slide_outcome.guard.stepped_in
    assert slide_outcome.window_guard.startswith("Over windows of 0.81 s that were not learned from")
    assert slide_outcome.learned.trust.tolist() == [1.0, 1.0]
    assert slide_outcome.learned.gp.num_points <= 800
    assert any(note.startswith("a: Velocities are slopes") for note in slide_outcome.notes)
    assert slide_outcome.notes[-1].startswith(f"Time step {slide_outcome.simulator.dt:.6g} s; learned from")


def test_the_learned_force_is_the_friction(slide_outcome: Learned) -> None:
    """One step from velocity v without control, against MuJoCo's own: damping 1, dry friction 0.5 and mass 1."""
    speed = torch.tensor([-0.4, -0.2, 0.2, 0.4]).double()
    state = torch.stack([0 * speed, speed], dim=-1)
    change = slide_outcome.learned(state, torch.zeros(4, 1).double())[:, 1] - speed
    dt = slide_outcome.simulator.dt
    wanted = (speed.sign() * 0.5 + speed) * (math.exp(-dt) - 1.0)
    torch.testing.assert_close(change, wanted, rtol=0.15, atol=0.0)


def test_the_noise_floor_is_in_the_units_of_the_errors(slide_outcome: Learned) -> None:
    wanted = 1e-4 / slide_outcome.scale[0].item()
    assert slide_outcome.noise == pytest.approx(wanted, rel=0.1)


def test_a_rod_is_learned_across_the_seam_of_its_angle(rod: str, rod_run) -> None:
    outcome = learn(rod, [rod_run(seed=1), rod_run(seed=2)], [rod_run(seed=3)], max_points=250)
    assert outcome.simulator.state_space.angles == (0,)
    assert outcome.runs[0]["state"][:, 0].diff().abs().max() > 6.0  # the recording does cross it
    assert outcome.after.window.position_nrmse < outcome.before.window.position_nrmse / 4
    assert outcome.after.one_step.rmse["qvel.hip"] < outcome.before.one_step.rmse["qvel.hip"] / 4


def test_the_same_seed_gives_the_same_bits(slide: str, slide_run) -> None:
    results = [learn(slide, [slide_run()], max_points=60, seed=seed).after for seed in (0, 0, 1)]
    assert results[0].free_run == results[1].free_run
    assert torch.equal(results[0].free_states[0], results[1].free_states[0])
    assert results[0].free_run != results[2].free_run


def test_without_a_holdout_a_part_is_set_aside(slide: str, slide_run) -> None:
    single = learn(slide, [slide_run()], max_points=40)
    assert single.notes[0] == "Held out: the last fifth of run, rows 1281 to 1600."
    assert len(single.runs[0]) == math.floor(319 * 0.005 / single.simulator.dt + 1e-3)
    several = learn(slide, [slide_run("a"), slide_run("b", seed=1)], max_points=40)
    assert several.labels == ("b",)
    assert several.notes[0] == "Held out: b (1 of 2 runs)."


def test_the_guard_steps_in_where_learning_hurts(slide: str, slide_run, monkeypatch) -> None:
    """The model is right, the recording noisy, and a kernel that believes every point would over-fit."""
    fit = module.fit_hyperparameters

    def believe_everything(gp, **options):
        result = fit(gp, **options)
        gp.likelihood.noise = torch.full_like(gp.likelihood.noise, 1e-12)
        for part in gp.covar_module.base_kernel.kernels:
            part.base_kernel.lengthscale = 1e-2 * part.base_kernel.lengthscale
        return result

    monkeypatch.setattr(module, "fit_hyperparameters", believe_everything)
    outcome = learn(slide, [slide_run(seed=1, loss="")], [slide_run(seed=2, loss="")], dt=0.01, max_points=200)
    guard = outcome.guard
    assert guard.stepped_in
    assert str(guard).startswith("The guard stepped in")
    assert bool((guard.guarded_rmse <= guard.simulator_rmse).all())
    assert outcome.learned.trust.min() < 0.9


def test_where_nothing_is_missing_nothing_is_spoiled(slide: str, slide_run) -> None:
    outcome = learn(slide, [slide_run(seed=1, loss="")], [slide_run(seed=2, loss="")], max_points=100)
    for kind in ("one_step", "window"):
        before, after = getattr(outcome.before, kind), getattr(outcome.after, kind)
        assert after.position_nrmse < 1.5 * before.position_nrmse + 3 * outcome.noise
    assert outcome.window_guard.startswith("The guard stepped in: over windows of")
    assert outcome.learned.trust.max() < 1.0


def test_a_known_external_force_is_not_learned(slide: str, slide_run) -> None:
    """A force that was recorded moves the simulator, so that the one that was not is all that is left."""
    plain = slide_run(loss="")
    forced = [
        Recording.from_columns(
            name,
            {
                "time": run.time,
                "qpos.slide": run["qpos.slide"],
                "ctrl.push": 0 * run.time,
                "qfrc.slide": run["ctrl.push"],
            },
        )
        for name, run in (("a", plain), ("b", slide_run(seed=5, loss="")))
    ]
    outcome = learn(slide, forced[:1], forced[1:], max_points=60)
    assert outcome.simulator.action_space.names == ("ctrl.push", "qfrc.slide")
    assert outcome.before.window.position_nrmse < 0.05
    assert outcome.external_force


def test_a_constant_control_and_a_single_state_do_not_break(tmp_path: Path, slide_run, slide: str) -> None:
    run = slide_run()
    still = run.replace({"ctrl.push": 0 * run.time})
    assert math.isfinite(learn(slide, [still], max_points=30).after.window.position_nrmse)


def test_recorded_velocities_are_used(slide: str, slide_run) -> None:
    run = slide_run()
    known = run.replace({"qvel.slide": torch.gradient(run["qpos.slide"], spacing=0.005)[0]})
    outcome = learn(slide, [known], max_points=30, dt=0.02)
    assert not any("Velocities" in note for note in outcome.notes)
    assert isinstance(outcome.simulator, MujocoSimulator)
    assert (outcome.simulator.dt, outcome.simulator.frame_skip) == (0.02, 4)


def test_bad_input_is_refused(slide: str, slide_run) -> None:
    with pytest.raises(ConfigurationError, match="--max-points: wanted at least 20, found 3"):
        learn(slide, [slide_run()], max_points=3)
    with pytest.raises(DataError, match=r"run: too short, \d+ transitions of 0.3 s to learn from"):
        learn(slide, [slide_run(seconds=1.0)], [slide_run("other", seed=1)], dt=0.3)
    with pytest.raises(DataError, match=r"a step of at least 0.005 s .* wanted, found 0.001 s"):
        learn(slide, [slide_run()], dt=0.001)
    with pytest.raises(DataError, match=r"`emps` has no ctrl.push; it has qpos.slide"):
        learn("emps", [slide_run()])


def test_emps_friction_is_learned(recordings_dir: Path) -> None:
    outcome = learn("emps", load_named(["emps:train"]), load_named(["emps:test"]), max_points=200)
    before, after = outcome.before, outcome.after
    assert outcome.simulator.dt == 0.05
    assert after.one_step.rmse["qvel.slide"] < before.one_step.rmse["qvel.slide"] / 10
    assert before.window.position_nrmse > 1.0
    assert after.window.position_nrmse < 0.02
    assert before.free_run.position_nrmse > 50.0
    assert after.free_run.position_nrmse < 0.2
    # the published force balance: 95.11 a = 35.15 u - 203.5 v - 20.39 sign(v) + 3.16
    state = torch.tensor([[0.12, 0.1], [0.12, -0.1]]).double()
    control = torch.tensor([[1.1], [-1.1]]).double()
    force = 95.11 * (outcome.learned(state, control) - outcome.simulator(state, control))[:, 1] / outcome.simulator.dt
    assert force.tolist() == pytest.approx([-37.6, 43.9], rel=0.15)
