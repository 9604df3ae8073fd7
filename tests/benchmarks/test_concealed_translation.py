"""The key's words and the package's mean the same physics: with true parameters the package fits the other code."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest

pytest.importorskip("numba")

from benchmarks.concealed import conceal
from benchmarks.concealed.cases import Draft, Spec
from benchmarks.concealed.effects import HOMES, NAMES, draw_effect
from benchmarks.concealed.oracle import Case, consult, true_sets
from benchmarks.concealed.plant import read_plant
from benchmarks.concealed.systems import SYSTEMS, write_model
from benchmarks.concealed.translation import forms_of, values_of
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.servo import ServoSaturation

SEED = 7


def hide(name: str, system: str, folder: Path, share: float = 0.1) -> dict[str, Any]:
    """Record a machine with an effect of a share of its largest amplitude, nearly without noise; give the key."""
    rng = np.random.default_rng(SEED)
    text = write_model(SYSTEMS[system], 100, rng, need_rotor=name == "backlash")
    model = mujoco.MjModel.from_xml_string(text)
    plant = read_plant(model)
    noise = np.full(model.njnt, 2e-4)
    recorder = conceal.Recorder(100, noise, 0 * noise, 0.0, 0.0, 0.0, 0.0, False, False, 0.0)
    runs = conceal.draw_runs(SYSTEMS[system], plant, recorder, 2, rng)
    spec = Spec("single", 0, "case", SEED)
    draft = Draft(spec, system, SYSTEMS[system].servo, text, model, plant, recorder, runs, 1)
    typical = draft.typical()
    effect = draw_effect(name, typical, rng)
    size = share * effect.most
    motions = draft.move(effect.on(plant, size), runs)
    (folder / "model.xml").write_text(text, encoding="utf-8")
    for number, (run, motion) in enumerate(zip(runs, motions, strict=True)):
        table = conceal.table(run, motion, recorder, (typical.joints, typical.actuators), rng)
        role = "test" if number else "train"
        pd.DataFrame(table).to_csv(folder / f"{role}_{number}.csv", index=False)
    return json.loads(json.dumps(draft.key([effect], [size], typical, 2.0) | {"tuning": []}))


def misfits(case: Case, key: dict[str, Any]) -> tuple[float, float]:
    """chi2 per degree of freedom of the nominal and of the true parameters, only initial states fitted."""
    *_, engine = case.engines()
    shooting, starts = Shooting(engine, case.segments, case.noise), engine.starts(case.segments)
    fits = shooting.fit([((), ()), *true_sets(case, key)], starts, hold=True)
    return fits[0].chi2 / shooting.dof, min(fit.chi2 for fit in fits[1:]) / shooting.dof


PLACES = {name: "pendulum" if "pendulum" in HOMES[name] else HOMES[name][0] for name in NAMES} | {
    "center_of_mass_offset": "double", "sensor_gain": "planar", "constant_force": "cartpole", "payload_mass": "double",
}  # fmt: skip


SHARES = {"joint_stop": 0.8, "actuator_saturation": 0.6}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_true_parameters_explain_what_the_other_code_did(name: str, tmp_path: Path) -> None:
    key = hide(name, PLACES[name], tmp_path, SHARES.get(name, 0.1))
    before, after = misfits(Case.read(tmp_path), key)
    assert before > 50
    assert after < 1.5 + (0.05 if name == "backlash" else 1e-3) * before


@pytest.mark.slow
def test_a_servo_is_saturated_in_its_force(tmp_path: Path) -> None:
    key = hide("actuator_saturation", "arm7", tmp_path, share=0.98)
    case = Case.read(tmp_path)
    ((effects, _),) = true_sets(case, key)
    assert isinstance(effects[0], ServoSaturation)
    before, after = misfits(case, key)
    assert before > 5 * after


@pytest.fixture(scope="module")
def double(tmp_path_factory: pytest.TempPathFactory) -> Case:
    folder = tmp_path_factory.mktemp("double")
    hide("viscous_friction", "double", folder)
    return Case.read(folder)


def test_what_an_effect_describes_leads_back_to_its_values(double: Case) -> None:
    rng = np.random.default_rng(0)
    for effect in double.effects:
        values = effect.seeds[-1] * rng.uniform(0.5, 1.5, len(effect.parameters))
        again = values_of(effect, effect.describe(values))
        assert again is not None
        np.testing.assert_allclose(again, values, rtol=1e-12, err_msg=str(effect))


def test_forms_of_a_name(double: Case) -> None:
    body = next(effect.target for effect in double.effects if effect.name == "payload_mass")
    forms = forms_of("payload_mass", body, {"mass": 0.1}, double.effects)
    assert {form[0][0].variant for form in forms} == {"center", "end", "density"}
    (form,) = forms_of("gravity_error", "world", {"change_x": 0.2, "change_y": 1e-12, "change_z": 0.1}, double.effects)
    assert [(effect.variant, *values) for effect, values in form] == [("x", 0.2), ("z", 0.1)]
    assert forms_of("viscous_friction", "joint:nobody", {"coefficient": 1.0}, double.effects) == []


@pytest.mark.slow
def test_the_oracle_forecasts_down_to_the_noise_and_checks_a_tie(tmp_path: Path) -> None:
    folder, keys, said = (tmp_path / part for part in ("cases/case", "keys", "results/diagnosis/case"))
    for path in (folder, keys, said):
        path.mkdir(parents=True)
    key = hide("viscous_friction", "pendulum", folder, share=0.05)
    (keys / "case.json").write_text(json.dumps(key), encoding="utf-8")
    target = key["effects"][0]["target"]
    drag = {"name": "quadratic_drag", "target": target, "parameters": {"coefficient": {"value": 0.01}}}
    (said / "diagnosis.json").write_text(json.dumps({"verdict": "tie", "effects": [drag]}), encoding="utf-8")
    consult(folder, tmp_path / "out")
    answer = json.loads((tmp_path / "out" / "oracle.json").read_text(encoding="utf-8"))
    errors = answer["holdout"]["free_run"]
    assert errors["oracle"] < 1.3 * errors["noise"]
    (found,) = answer["effects"]
    true = key["effects"][0]["parameters"]["coefficient"]["value"]
    assert found["parameters"]["coefficient"] == pytest.approx(true, rel=0.02)
    assert answer["tie"]["chi2"] > 2 * answer["chi2"]


def test_the_oracle_has_nothing_to_say_of_a_control(tmp_path: Path) -> None:
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys" / "case.json").write_text(json.dumps({"kind": "controls", "effects": []}), encoding="utf-8")
    consult(tmp_path / "cases" / "case", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "oracle.json").read_text(encoding="utf-8")) == {"case": "case"}
