"""What a displacement moves, against inertias worked out by hand."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.coupling import coupling


def test_an_arm_stays_behind_what_carries_it(double) -> None:
    """At rest the lower arm has J = 0.152 about its joint, and 0.28 more about the shoulder's motion."""
    model = double.model()
    for elbow, moved in ((0.0, (0.152 + 0.28) / 0.152), (np.pi / 2, 1.0)):
        found = coupling(model, np.array([[0.3, elbow]]), np.array([1]), np.array([0]))
        assert found[0, 0] == pytest.approx(moved)


def test_joints_that_nobody_recorded_move_freely() -> None:
    """A cart on a cart on rails: the upper one stays where it is; a weight between them changes nothing for it."""
    cart = '<body pos="0 0 1"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="2"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{3 * cart}{3 * '</body>'}</worldbody></mujoco>")
    poses = np.zeros((5, 3))
    np.testing.assert_allclose(coupling(model, poses, np.array([1]), np.array([0])), [[1.0]])
    np.testing.assert_allclose(coupling(model, poses, np.array([2]), np.array([0])), [[0.0]], atol=1e-12)
