from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from torch_activegp.data import load_recordings
from torch_activegp.experiments import demo
from torch_activegp.experiments.demo import CHOICES, MODEL, Secret, conceal, integrate, score, write_demo
from torch_activegp.physics.actuation import ACTUATION
from torch_activegp.physics.catalogue import JOINT_EFFECTS

CONTROL = 1.2 * np.sin(np.linspace(0.0, 12.0, 201)) + 0.2
START = (0.5, -0.3)
MIDDLE = {choice.name: 0.5 * (choice.low + choice.high) for choice in CHOICES}


def reference(name: str, value: float) -> np.ndarray:
    """The same pendulum by scipy, each law written anew, sample by sample."""

    def law(_: float, state: np.ndarray, u: float) -> list[float]:
        q, v = state
        torque = u - 0.05 * v - 1.0 * 9.81 * 0.25 * math.sin(q)
        torque += {
            "viscous_friction": -value * v,
            "coulomb_friction": -value * math.tanh(v / 1e-5),
            "quadratic_drag": -value * v * abs(v),
            "linear_spring": -value * q,
            "constant_force": value,
        }.get(name, 0.0)
        return [v, torque / 0.1]

    delay = 0.01 if name == "actuator_delay" else 0.0
    control = {"actuator_gain": value * CONTROL, "actuator_saturation": np.clip(CONTROL, -value, value)}.get(
        name, CONTROL
    )
    state, angles = np.array(START), [START[0]]
    for k in range(len(CONTROL) - 1):
        u = control[max(k - round(delay * 100), 0)]
        options: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-11, "method": "LSODA"}
        state = solve_ivp(law, (0.0, 0.01), state, args=(u,), **options).y[:, -1]
        angles.append(state[0])
    return np.array(angles)


@pytest.mark.parametrize("name", MIDDLE)
def test_the_truth_equals_scipys(name: str) -> None:
    value = 0.01 if name == "actuator_delay" else MIDDLE[name]
    angles = integrate(Secret(name, value=value), CONTROL, START)
    np.testing.assert_allclose(angles, reference(name, value), atol=2e-5 if name == "coulomb_friction" else 1e-7)
    if name != "none":
        assert np.abs(angles - reference("none", 0.0)).max() > 5e-3


def test_a_delay_between_two_samples() -> None:
    early, late = (integrate(Secret("actuator_delay", value=s), CONTROL, START) for s in (0.004, 0.009))
    between = integrate(Secret("actuator_delay", value=0.0065), CONTROL, START)
    np.testing.assert_allclose(between, 0.5 * (early + late), atol=1e-4)
    assert np.abs(late - early).max() > 1e-3


def test_dry_friction_sticks_and_does_not_depend_on_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    secret = Secret("coulomb_friction", value=0.05)
    resting = integrate(secret, np.zeros(101), (0.015, 0.0))
    assert (resting == 0.015).all()
    coarse = integrate(secret, CONTROL, START)
    monkeypatch.setattr(demo, "_STEPS", 100)
    np.testing.assert_allclose(coarse, integrate(secret, CONTROL, START), atol=1e-6)


def test_with_nothing_hidden_the_model_agrees() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    model.opt.integrator, model.opt.timestep = int(mujoco.mjtIntegrator.mjINT_RK4), 0.001
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = START
    angles = [START[0]]
    for u in CONTROL[:-1]:
        data.ctrl[0] = u
        mujoco.mj_step(model, data, 10)
        angles.append(data.qpos[0])
    np.testing.assert_allclose(integrate(Secret("none"), CONTROL, START), angles, atol=1e-6)


def test_every_choice_is_drawn_and_is_an_effect_of_the_catalogue() -> None:
    known = {kind.name for kind in (*JOINT_EFFECTS, *ACTUATION)}
    secrets = [conceal(np.random.default_rng(seed)) for seed in range(100)]
    assert {secret.name for secret in secrets} == {choice.name for choice in CHOICES}
    assert {choice.name for choice in CHOICES} - {"none"} <= known
    for secret in secrets:
        (choice,) = (choice for choice in CHOICES if choice.name == secret.name)
        assert choice.low <= secret.value <= choice.high


def test_the_files_repeat_with_the_seed_and_hold_no_secret(tmp_path: Path) -> None:
    texts = []
    for folder, seed in (("a", 3), ("b", 3), ("c", 4)):
        (tmp_path / folder).mkdir()
        secret = write_demo(tmp_path / folder, seed)
        texts.append({path.name: path.read_text() for path in sorted((tmp_path / folder).iterdir())})
        assert not any(secret.name in text for text in texts[-1].values())
    assert texts[0] == texts[1]
    assert texts[0]["run1.csv"] != texts[2]["run1.csv"]
    assert set(texts[0]) == {"model.xml", *(f"run{i}.csv" for i in range(1, 7)), "test1.csv", "test2.csv"}
    runs = load_recordings(str(tmp_path / "a" / "run*.csv"))
    assert [(len(run), run.joints, run.actuators) for run in runs] == [(401, ("pivot",), ("motor",))] * 6


def test_a_secret_in_words() -> None:
    assert str(Secret("none")) == "nothing"
    assert str(Secret("actuator_gain", "actuator:motor", "gain", 0.981, "1")) == (
        "actuator_gain at actuator:motor, gain 0.981"
    )
    assert str(Secret("coulomb_friction", "joint:pivot", "level", 0.031, "N m")) == (
        "coulomb_friction at joint:pivot, level 0.031 N m"
    )


FORCE = {"name": "constant_force", "target": "joint:pivot"}
BIAS = {"name": "actuator_bias", "target": "actuator:motor"}
DRAG = {"name": "quadratic_drag", "target": "joint:pivot"}


@pytest.mark.parametrize(
    ("name", "verdict", "effects", "words"),
    [
        ("none", "none", [], "Right."),
        ("none", "named", [FORCE], "false alarm"),
        ("none", "unknown", [], "false alarm"),
        ("constant_force", "none", [], "missed"),
        ("constant_force", "unknown", [], "did not name it"),
        ("constant_force", "named", [FORCE], "Right."),
        ("constant_force", "tie", [{**FORCE, "ties": [BIAS]}], "Right, and it says"),
        ("constant_force", "tie", [{**BIAS, "ties": [FORCE]}], "up to a tie"),
        ("constant_force", "named", [FORCE, DRAG], "more than there is"),
        ("constant_force", "tie", [{**BIAS, "ties": [FORCE]}, DRAG], "something else"),
        ("constant_force", "named", [DRAG], "something else"),
        ("constant_force", "named", [{**FORCE, "target": "joint:elbow"}], "something else"),
    ],
)
def test_the_score(name: str, verdict: str, effects: list[dict[str, Any]], words: str) -> None:
    assert words in score(Secret(name, "joint:pivot"), {"verdict": verdict, "effects": effects})
