from __future__ import annotations

from typing import Any

import numpy as np

from torch_activegp.physics.drag import AsymmetricFriction, QuadraticDrag, ViscousFriction


def test_what_comes_on_top_cannot_make_a_coefficient_negative(bench: Any) -> None:
    model = bench.model
    model.dof_dampingpoly[0, 0] = 0.2
    assert QuadraticDrag.at(bench.shoulder, model).parameters[0].low == -0.2
    for kind in (ViscousFriction, AsymmetricFriction):
        assert {p.low for p in kind.at(bench.shoulder, model).parameters} == {-0.05}


def test_drag_grows_with_speed_and_may_differ_by_direction(bench: Any) -> None:
    speed = np.array([-2.0, -1.0, 1.0, 2.0])
    laws = {
        ViscousFriction: ([0.2], [0.4, 0.2, -0.2, -0.4]),
        QuadraticDrag: ([0.2], [0.8, 0.2, -0.2, -0.8]),
        AsymmetricFriction: ([0.2, 0.1], [0.2, 0.1, -0.2, -0.4]),
    }
    for kind, (values, wanted) in laws.items():
        np.testing.assert_allclose(kind.at(bench.shoulder, bench.model).force(0.0 * speed, speed, values), wanted)
