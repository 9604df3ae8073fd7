"""Independent jobs in several processes of joblib, which report as they go."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Client, Listener
from typing import Any

import torch
from joblib import Parallel, delayed
from joblib.externals.loky import get_reusable_executor

from torch_activegp.errors import ActiveGPError

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


def run_jobs(
    work: Callable[[Any], Iterable[Any]], jobs: Sequence[Any], num_processes: int, tell: Tell = lambda _: None
) -> dict[Any, list[Any]]:
    """Do independent jobs side by side.

    Every job computes on one thread of torch, so its result does not depend on the number of processes. The processes
    end with the jobs, at once at an error or at Ctrl-C, and at the next message when this one was killed.

    Args:
        work: from a job to its messages; like these, it can be pickled if there is more than one process.
        jobs: what to do, in this order; hashable.
        num_processes: how many at once; with one, everything happens in this process.
        tell: called with each message as it comes, in a thread of this process if there are others.

    Returns:
        The messages of each job.

    Raises:
        ActiveGPError: what a job raised, or a process was killed.
    """
    num_processes = min(num_processes, len(jobs))
    if num_processes <= 1:
        return dict(_do(work, tell, job) for job in jobs)
    try:
        with heard_by(tell) as tell_parent:
            pool = Parallel(num_processes, backend="loky", return_as="generator_unordered", batch_size=1)
            with interrupts_ignored():
                results = pool(delayed(_do)(work, tell_parent, job) for job in jobs)
            return dict(results)
    except BrokenProcessPool as error:
        raise ActiveGPError(
            "A worker process was killed, as happens when memory runs out. Use fewer --jobs; --resume keeps every "
            "complete episode."
        ) from error
    finally:
        get_reusable_executor(reuse=True).shutdown(kill_workers=True)


def _do(work: Callable[[Any], Iterable[Any]], tell: Tell, job: Any) -> tuple[Any, list[Any]]:
    messages = []
    with one_thread():
        for message in work(job):
            tell(message)
            messages.append(message)
    return job, messages


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
