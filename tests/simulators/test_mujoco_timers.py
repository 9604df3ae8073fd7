from __future__ import annotations

import mujoco
import pytest

from torch_activegp.simulators import mujoco_timers
from torch_activegp.simulators.mujoco_timers import without_timers

STEP = int(mujoco.mjtTimer.mjTIMER_STEP)


def is_timed() -> bool:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    return float(data.timer[STEP].duration) > 0.0


def test_no_step_is_timed_within_the_block_and_every_one_after_it() -> None:
    assert is_timed()
    with without_timers():
        assert not is_timed()
    assert is_timed()


def test_blocks_that_overlap_end_with_the_clock_from_before() -> None:
    one, two = without_timers(), without_timers()
    one.__enter__()
    two.__enter__()
    one.__exit__(None, None, None)
    assert not is_timed()
    two.__exit__(None, None, None)
    assert is_timed()


def test_an_error_inside_brings_the_clock_back() -> None:
    with pytest.raises(KeyError), without_timers():
        raise KeyError
    assert is_timed()


def test_nothing_happens_where_the_variable_is_not_to_be_found(monkeypatch) -> None:
    monkeypatch.delattr(mujoco_timers.mujoco._callbacks, "__file__")
    with without_timers():
        assert is_timed()
