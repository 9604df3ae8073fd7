"""MuJoCo's profiler, which takes a third of a small model's time and more: it reads the clock 28 times in a step."""

from __future__ import annotations

import ctypes
import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

_lock = threading.Lock()
_found: list[int | None] = []
"""What the first of the blocks that overlap found, and one more for each of them."""


@contextmanager
def without_timers() -> Iterator[None]:
    """Turns MuJoCo's profiler off within a ``with`` block: ``MjData.timer`` stands still, in other threads too.

    MuJoCo has one callback ``mjcb_time`` for the whole process, and calls none where that is null. The Python package
    installs one, and installs it again for ``mujoco.set_mjcb_time(None)``. Where blocks overlap, what the first one
    found comes back when the last one ends, unless another callback was installed by then. Where the variable cannot
    be reached, nothing happens.
    """
    clock = _clock()
    if clock is None:
        yield
        return
    with _lock:
        if not _found:
            _found.append(clock.value)
            clock.value = None
        _found.append(None)
    try:
        yield
    finally:
        with _lock:
            _found.pop()
            if len(_found) == 1:
                found = _found.pop()
                clock.value = clock.value or found


@functools.cache
def _clock() -> ctypes.c_void_p | None:
    """The variable that points to the callback, by way of the package's own extension that is linked to MuJoCo."""
    try:
        return ctypes.c_void_p.in_dll(ctypes.CDLL(mujoco._callbacks.__file__), "mjcb_time")
    except (AttributeError, OSError, ValueError):
        return None
