"""MuJoCo's warnings go where Python code wants them, not to the terminal and a file in the working folder."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco

_lock = threading.Lock()
_handlers: list[Callable[[str], None]] = []


@contextmanager
def warnings_to(handler: Callable[[str], None]) -> Iterator[None]:
    """Hands MuJoCo's warnings to ``handler`` within a ``with`` block.

    MuJoCo has one warning handler for the whole process. Blocks that overlap in several threads share the first one's;
    the handler from before comes back when the last block ends.

    Args:
        handler: function of the message; MuJoCo may call it from any thread.
    """
    with _lock:
        if not _handlers:
            _handlers.append(mujoco.get_mju_user_warning())
            mujoco.set_mju_user_warning(handler)
        _handlers.append(handler)
    try:
        yield
    finally:
        with _lock:
            _handlers.pop()
            if len(_handlers) == 1:
                mujoco.set_mju_user_warning(_handlers.pop())
