from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.selection.own_limits import is_own_limit
from torch_activegp.diagnosis.simulation.places import effects_for

LIMITED = '<motor name="drive" joint="hip" ctrllimited="true" ctrlrange="-0.5 0.5"/>'


@pytest.mark.parametrize(
    ("limit", "beside", "own"),
    [
        (0.5, "actuator_bias", True),
        (0.496, "actuator_gain", True),
        (0.4, "actuator_bias", False),
        (0.5, "actuator_lag", False),
        (0.5, None, False),
    ],
)
def test_a_limit_that_the_control_has_is_none_of_the_drives(clean, limit: float, beside: str | None, own: bool) -> None:
    model = mujoco.MjModel.from_xml_string(clean.xml.replace('<motor name="drive" joint="hip"/>', LIMITED))
    machine = clean.machine
    effects = {e.name: e for e in effects_for(model, machine.channels, machine.fit) if e.target == "actuator:drive"}
    saturation = effects["actuator_saturation"]
    values = {saturation: np.array([limit])} | ({} if beside is None else {effects[beside]: np.array([0.01])})
    assert is_own_limit(model, saturation, values) == own
    assert not is_own_limit(clean.machine.model, saturation, values)  # whose control has no limit
    if beside is not None:
        assert not is_own_limit(model, effects[beside], values)


@pytest.mark.parametrize(("limit", "own"), [(0.8, True), (0.5, False)])
def test_the_drive_needs_no_name_and_the_farther_end_counts(clean, limit: float, own: bool) -> None:
    motor = '<motor joint="hip" ctrllimited="true" ctrlrange="-0.8 0.5"/>'
    model = mujoco.MjModel.from_xml_string(clean.xml.replace('<motor name="drive" joint="hip"/>', motor))
    machine = clean.machine
    effects = {e.name: e for e in effects_for(model, machine.channels, machine.fit) if e.target == "actuator:actuator0"}
    saturation = effects["actuator_saturation"]
    values = {saturation: np.array([limit]), effects["actuator_bias"]: np.array([0.01])}
    assert is_own_limit(model, saturation, values) == own
