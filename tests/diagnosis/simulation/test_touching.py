from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.simulation.touching import is_tied, now_and_then, touching, widened


def test_rows_at_a_limit_touch_and_a_wider_model_sees_them_before(bench) -> None:
    run, channels = bench.machine.fit[0], bench.engine.channels
    highest = float(np.quantile(run.smooth, 0.8))
    model = bench.integrated("RK4", 0.005, f'limited="true" range="-900 {np.rad2deg(highest)}"').model
    rows = np.arange(len(run))
    at = touching(model, channels, run, rows)
    np.testing.assert_array_equal(at, run.smooth[:, 0] > highest)
    near = touching(widened(model), channels, run, rows)
    np.testing.assert_array_equal(near, run.smooth[:, 0] > highest - 0.005 * (highest + np.deg2rad(900)))
    assert near.sum() > at.sum()
    np.testing.assert_array_equal(touching(model, channels, run, rows[::7]), at[::7])
    assert not touching(bench.machine.model, channels, run, rows).any()


def test_what_is_about_to_touch_is_seen_before() -> None:
    """A tip that hangs a little above a floor."""

    def hung(gap: float) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
            <geom type="plane" size="1 1 1" pos="0 0 {-1.1 - gap}"/><body><joint type="slide" axis="1 0 0"/>
            <geom type="sphere" size="0.1" pos="0 0 -1" mass="1"/></body></worldbody></mujoco>""")

    for gap, contacts in ((-1e-3, (1, 1)), (1e-3, (0, 1)), (0.1, (0, 0))):
        for model, wanted in zip((hung(gap), widened(hung(gap))), contacts, strict=True):
            data = mujoco.MjData(model)
            mujoco.mj_fwdPosition(model, data)
            assert data.ncon == wanted


@pytest.mark.parametrize(
    ("tendon", "equality", "tied"),
    [
        ("", "", False),
        ("", '<equality><joint joint1="one" joint2="other"/></equality>', True),
        ('group="1"', "", False),
        ('frictionloss="0.1"', "", True),
        ('armature="0.1"', "", True),
        ('stiffness="3"', "", True),
        ('damping="0.1"', "", True),
        ('limited="true" range="-1 1"', "", True),
    ],
)
def test_a_tendon_that_only_passes_on_what_a_drive_pulls_ties_nothing(tendon: str, equality: str, tied: bool) -> None:
    body = '<body><joint name="{}" type="slide"/><geom size="0.1"/></body>'
    cable = f"""<tendon><fixed name="cable" {tendon}><joint joint="one" coef="2"/></fixed></tendon>
        <actuator><motor tendon="cable"/></actuator>"""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>{body.format("one")}{body.format("other")}</worldbody>
        {cable if tendon else ""}{equality}</mujoco>""")
    assert model.ntendon == bool(tendon)
    assert is_tied(model) == tied


@pytest.mark.parametrize(("touching_poses", "expected"), [(0, False), (1, False), (2, True), (99, True), (100, False)])
def test_what_touches_now_and_then_does_so_neither_by_accident_nor_always(touching_poses: int, expected: bool) -> None:
    assert now_and_then(np.arange(100) < touching_poses) == expected
