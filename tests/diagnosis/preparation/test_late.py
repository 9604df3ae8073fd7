from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.preparation.late import otherwise_late, without_delays


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
