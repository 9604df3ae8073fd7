from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics.actuation import (
    ACTUATION,
    ActuatorBias,
    ActuatorDelay,
    ActuatorGain,
    ActuatorLag,
    ActuatorSaturation,
)


def test_a_drives_whole_chain_is_that_of_the_models_file(bench: Any) -> None:
    """A delay and a lag of the control, then gain, bias and limit of the force."""
    kinds = {ActuatorSaturation: [0.9], ActuatorBias: [0.25], ActuatorLag: [0.05], ActuatorDelay: [0.02]}
    chain = [(kind.at(bench.drive, bench.model), np.array(values)) for kind, values in kinds.items()]
    gain = (ActuatorGain.at(bench.drive, bench.model), np.array([0.4]))
    chain = sorted([*chain, gain], key=lambda pair: pair[0].order)
    control = bench.control[None, None].copy()
    for effect, values in chain:
        effect.control(control, np.full((1, 1000), 1e-3), values[None])
    spec = bench.spec
    assert all(effect.write(spec, values) for effect, values in chain)
    written = bench.run(spec.compile())
    assert bench.gap(bench.run(bench.model, control[0, 0]), written) < 5e-3
    limit = ActuatorSaturation.at(bench.drive, bench.model)  # before the lag it would cut off less
    before = bench.control[None, None].copy()
    for effect, values in [(limit, np.array([0.9])), *chain[:-1]]:
        effect.control(before, np.full((1, 1000), 1e-3), values[None])
    assert bench.gap(bench.run(bench.model, before[0, 0]), written) > 0.02


def test_the_chain_goes_from_the_command_to_the_force() -> None:
    names = [kind.name.removeprefix("actuator_") for kind in sorted(ACTUATION, key=lambda kind: kind.order)]
    assert names == ["delay", "lag", "dead_zone", "gain", "bias", "saturation"]


def test_an_effect_knows_the_drive_that_it_acts_on(bench: Any) -> None:
    drive, servo = (ActuatorGain.at(place, bench.model) for place in (bench.drive, bench.servo))
    assert (drive.index, drive.drives, drive.gear, drive.nominal_gain) == (0, "joint:shoulder", 2.0, 1.0)
    assert (servo.index, servo.drives, servo.nominal_gain) == (1, "joint:elbow", 5.0)
    assert drive.nominal == (0.0, int(mujoco.mjtDyn.mjDYN_NONE))
    assert drive.actuator(bench.spec).name == "drive"
    own = bench.xml.replace("<motor", '<general biastype="affine" biasprm="0.3 0 0" dyntype="filter" dynprm="0.1"')
    filtered = ActuatorGain.at(bench.drive, mujoco.MjModel.from_xml_string(own))
    assert filtered.nominal == (pytest.approx(0.3), int(mujoco.mjtDyn.mjDYN_FILTER))
