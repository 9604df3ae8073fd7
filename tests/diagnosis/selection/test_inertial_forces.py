from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.selection.inertial_forces import change, inertial_forces, with_effects
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.inertia import ArmatureError, CenterOfMassOffset, GravityError
from torch_activegp.physics.payload import DensityError, PayloadAside, PayloadMass
from torch_activegp.physics.place import Place

_ARM = """<mujoco><worldbody><body name="base"><joint name="yaw" axis="0 0 1" armature="0.1"/>
<geom type="box" size="0.1 0.05 0.08" pos="0.03 0 0.1" mass="2"/>
<body name="tilted" pos="0.1 0.2 0.3" euler="20 -30 50"><joint name="lift" type="slide" axis="0.2 0.3 1"/>
<geom type="capsule" size="0.04" fromto="0 0 0 0.3 0.1 0.2" mass="1.5"/>
<body name="tip" pos="0.3 0.1 0.2" euler="-40 10 0"><joint name="wrist" axis="1 1 0"/>
<geom type="box" size="0.1 0.03 0.05" pos="0.02 0.04 -0.06" euler="10 20 30" mass="0.7"/>
</body></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def arm() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_ARM)


def _effects(model: mujoco.MjModel) -> list[tuple[Effect, np.ndarray]]:
    found: list[tuple[Effect, np.ndarray]] = []
    for name in ("base", "tilted", "tip"):
        place, reach = Place(f"body:{name}", model.body(name).id), np.array([0.1, -0.05, 0.2])
        found += [
            (PayloadMass.at(place, model), np.array([0.3])),
            (PayloadMass.at(place, model, reach, "end"), np.array([0.3])),
            (PayloadAside.within(place, model, reach, (0, 2)), np.array([0.2, 0.07, -0.1])),
            (DensityError.at(place, model), np.array([-0.2])),
            (CenterOfMassOffset.along(place, 0.1, 1), np.array([0.05])),
        ]
    return [*found, (GravityError.along(0, 2), np.array([1.5, -2.0]))]


def _torque(model: mujoco.MjModel, motion: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    out = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in motion:
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse.copy())
    return np.array(out)


def test_the_force_is_what_the_edited_machine_wants_less(arm: mujoco.MjModel) -> None:
    """Against inverse dynamics of the model with the effect written into it."""
    motion = np.random.default_rng(0).normal(size=(7, 3, arm.nv))
    effects = _effects(arm)
    changes = [change(arm, *pair) for pair in effects]
    assert None not in changes
    forces = inertial_forces(arm, *motion.transpose(1, 0, 2), changes)
    assert forces.shape == (7, arm.nv, len(effects))
    plain = _torque(arm, motion)
    for i, (effect, values) in enumerate(effects):
        edited = copy.copy(arm)

        def field(name: str, edited: mujoco.MjModel = edited) -> np.ndarray:
            return (edited.opt.gravity if name == "opt.gravity" else getattr(edited, name))[None]

        effect.edit(field, np.array([0]), values[None])
        wanted = plain - _torque(edited, motion)
        np.testing.assert_allclose(forces[..., i], wanted, atol=1e-9 * np.abs(plain).max(), err_msg=str(effect.key))
        assert np.abs(wanted).max() > 1e-4


def test_what_does_more_is_left_to_simulations(arm: mujoco.MjModel) -> None:
    class Held(PayloadMass):
        needs_steps = True

    class Pushing(PayloadMass):
        def steady(self, force, rows, values) -> None:
            force[rows, 0] += 1.0

    class Reading(PayloadMass):
        def measure(self, read, values):
            return 0, read(0, np.zeros(len(values)))

    class Driving(PayloadMass):
        def control(self, control, dt, values):
            return control

    place = Place("body:tip", arm.body("tip").id)
    for kind in (Held, Pushing, Reading, Driving):
        assert change(arm, kind.at(place, arm), np.array([0.1])) is None
    rotor = ArmatureError.at(Place("joint:yaw", 0), arm)
    assert change(arm, rotor, np.array([0.1])) is None
    floating = copy.copy(arm)
    floating.body_gravcomp[2] = 1.0
    assert change(floating, PayloadMass.at(place, arm), np.array([0.1])) is None
    assert change(arm, PayloadMass.at(place, arm), np.array([0.1])) is not None


def test_a_machine_that_does_not_fall_feels_no_other_gravity(arm: mujoco.MjModel) -> None:
    floating = copy.copy(arm)
    floating.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    tilted = change(floating, GravityError.along(0), np.array([1.0]))
    assert tilted is not None
    for model, falls in ((arm, True), (floating, False)):
        force = inertial_forces(model, *np.full((3, 1, arm.nv), 0.3), [tilted])
        assert bool(force.any()) == falls


def test_changes_come_on_top_of_what_is_known_already(arm: mujoco.MjModel) -> None:
    """Twice the mass weighs twice as much on a planet with twice the gravity."""
    place = Place("body:tip", arm.body("tip").id)
    heavy = with_effects(arm, [DensityError.at(place, arm)], [np.array([0.7])])
    assert heavy.body_mass[place.index] == pytest.approx(1.4)
    assert heavy.body_subtreemass[0] == pytest.approx(arm.body_subtreemass[0] + 0.7)
    shift = CenterOfMassOffset.along(place, 0.1, 1), np.array([0.05])
    pose = np.full((3, 1, arm.nv), 0.3)
    alone, loaded = (inertial_forces(model, *pose, [change(model, *shift)]) for model in (arm, heavy))
    np.testing.assert_allclose(loaded, 2.0 * alone, rtol=0.1)
    assert arm.body_mass[place.index] == pytest.approx(0.7)
