from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import mujoco
import numpy as np
import pytest

from torch_activegp.simulators import mujoco_timers
from torch_activegp.simulators.mujoco_batch import BatchRunner
from torch_activegp.simulators.mujoco_timers import without_timers

MODEL = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>")


class Clock:
    """Counts how often MuJoCo reads it."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> float:
        self.times += 1
        return float(self.times)

    def is_read(self) -> bool:
        """Whether a step reads it."""
        before = self.times
        mujoco.mj_step(MODEL, mujoco.MjData(MODEL))
        return self.times > before


@pytest.fixture
def clock() -> Iterator[Clock]:
    made = Clock()
    mujoco.set_mjcb_time(made)
    yield made
    mujoco.set_mjcb_time(None)


def test_no_step_is_timed_within_the_block_and_every_one_after_it(clock) -> None:
    assert clock.is_read()
    with without_timers():
        assert not clock.is_read()
    assert clock.is_read()


def test_blocks_that_overlap_end_with_the_clock_from_before(clock) -> None:
    with ExitStack() as one, ExitStack() as two:
        one.enter_context(without_timers())
        two.enter_context(without_timers())
        one.close()
        assert not clock.is_read()
        two.close()
        assert clock.is_read()


def test_an_error_inside_brings_the_clock_back(clock) -> None:
    with pytest.raises(KeyError), without_timers():
        raise KeyError
    assert clock.is_read()


def test_a_clock_that_is_installed_inside_stays(clock) -> None:
    other = Clock()
    with without_timers():
        mujoco.set_mjcb_time(other)
    assert other.is_read()
    with without_timers():
        mujoco.set_mjcb_time(None)
    mujoco.mj_step(MODEL, mujoco.MjData(MODEL))
    assert not other.is_read()


def test_nothing_happens_where_the_variable_is_not_to_be_found(clock, monkeypatch) -> None:
    monkeypatch.setattr(mujoco_timers, "_clock", lambda: None)
    with without_timers():
        assert clock.is_read()


def test_a_library_that_has_no_such_variable_is_no_error(monkeypatch) -> None:
    monkeypatch.delattr(mujoco._callbacks, "__file__")
    assert mujoco_timers._clock.__wrapped__() is None


def test_batches_are_stepped_without_timers(clock) -> None:
    runner, state = BatchRunner(MODEL, 1), np.zeros((2, 2))
    runner.step(state, np.zeros((2, 0)), 3)
    runner.rollout(state, np.zeros((2, 3, 0)), 1)
    assert clock.times == 0
