"""What work in several processes needs: one thread each, a way to report, and nothing to do with Ctrl-C."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Client, Listener
from typing import Any

import torch

Tell = Callable[[Any], None]
"""Takes a message of a job."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch on one thread: faster for small matrices beside other processes, and the same bits in each of them."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@contextmanager
def heard_by(tell: Tell) -> Iterator[Tell]:
    """A function for other processes that calls one of this process, in a thread."""
    with Listener(backlog=64) as listener:
        thread = threading.Thread(target=_hear, args=(listener, tell), daemon=True)
        thread.start()
        try:
            yield partial(_tell_parent, listener.address)
        finally:
            with suppress(OSError), Client(listener.address) as connection:  # gone if `tell` raised an error
                connection.send(None)
            thread.join()


def _hear(listener: Listener, tell: Tell) -> None:
    message: Any = ...
    with listener:
        while message is not None:
            with suppress(EOFError, OSError), listener.accept() as connection:  # a process was killed as it spoke
                message = connection.recv()
                if message is not None:
                    tell(message)


def _tell_parent(address: Any, message: Any) -> None:
    try:
        with Client(address) as connection:
            connection.send(message)
    except OSError:  # nobody is there any more to work for
        os._exit(1)


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Processes that start now leave Ctrl-C to this one, which ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
