from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.preparation.late import otherwise_late, without_delays, without_half_steps


def test_a_set_may_be_late_in_another_way(clean) -> None:
    lag, delay = (clean.effect(name, "actuator:drive") for name in ("actuator_lag", "actuator_delay"))
    wet, dry = clean.effect("viscous_friction"), clean.effect("coulomb_friction")
    value = np.array([0.01])
    some = [((wet, delay), (value, value)), ((delay, wet), (value, value)), ((wet,), (value,)), ((dry, lag), (value,))]
    assert otherwise_late([((lag, wet), (value, value)), *some]) == [*some[:2]]
    assert otherwise_late([((wet,), (value,)), *some]) == []
    assert otherwise_late([]) == []


def test_what_a_wrong_time_step_looks_like_is_left_out(clean) -> None:
    lag, wet = clean.effect("actuator_lag", "actuator:drive"), clean.effect("viscous_friction")
    value = np.array([0.01])
    assert without_delays([((wet, lag), (2 * value, value)), ((wet,), (value,))]) == [((wet,), (2 * value,))]


@pytest.mark.parametrize(("stiffness", "damping"), [(6.0, 0.0), (0.0, 4.0)])
def test_half_a_time_step_is_damping_of_a_servo_and_inertia_of_a_damper(
    clean, stiffness: float, damping: float
) -> None:
    servo = f'<general joint="hip" biastype="affine" gainprm="0" biasprm="0 {-stiffness} {-damping}"/>'
    model = mujoco.MjModel.from_xml_string(clean.xml.replace('<motor name="drive" joint="hip"/>', servo))
    name, late = ("viscous_friction", stiffness) if stiffness else ("armature_error", damping)
    effect, dry, step, much = clean.effect(name), clean.effect("coulomb_friction"), 0.002, np.array([0.1])
    late += 0.0 if stiffness else model.dof_damping[0]
    small, large = (np.array([times * step * late]) for times in (-0.5, -2.0))
    assert without_half_steps([((effect, dry), (small, much))], model, step) == [((dry,), (much,))]
    assert without_half_steps([((effect,), (small,))], model, step) == [((), ())]
    assert without_half_steps([((effect, dry), (large, much))], model, step) == []
    assert without_half_steps([((dry,), (np.array([1e-9]),))], model, step) == []


def test_a_motor_has_no_stiffness_that_a_time_step_could_be(clean) -> None:
    """Gravity and springs are where they should be: the scheme holds them at the joint's own position."""
    wet = clean.effect("viscous_friction")
    assert without_half_steps([((wet,), (np.array([1e-9]),))], clean.machine.model, 0.01) == []
