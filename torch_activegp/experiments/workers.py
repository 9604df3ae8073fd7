"""Independent jobs in several processes of joblib, which report as they go."""

from __future__ import annotations

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
"""Takes one message of a job."""


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
    work: Callable[[Any], Iterable[Any]], jobs: Sequence[Any], num_processes: int, on_message: Tell = lambda _: None
) -> dict[Any, list[Any]]:
    """Do independent jobs side by side.

    Every job computes on one thread of torch, so its result does not depend on the number of processes. An error and
    Ctrl-C end the processes at once.

    Args:
        work: from a job to what it has to tell; like jobs and messages, it can be pickled if there are more processes.
        jobs: what to do, in this order; hashable.
        num_processes: how many at once; with one, everything happens in this process.
        on_message: takes each message of each job at once, in a thread if there are more processes.

    Returns:
        What each job told.

    Raises:
        ActiveGPError: what a job raised, or a process died.
    """
    num_processes = min(num_processes, len(jobs))
    if num_processes <= 1:
        return {job: _do(work, on_message, job)[1] for job in jobs}
    try:
        with _heard_by(on_message) as tell:
            pool = Parallel(num_processes, backend="loky", return_as="generator_unordered", batch_size=1)
            with _interrupts_ignored():  # the processes inherit this: Ctrl-C reaches only this one, which ends them
                results = pool(delayed(_do)(work, tell, job) for job in jobs)
            return dict(results)
    except BrokenProcessPool as error:
        raise ActiveGPError(
            "A worker process was killed, often because memory ran out. Use fewer --jobs; --resume keeps every "
            f"complete episode. ({str(error).splitlines()[-1]})"
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
def _heard_by(on_message: Tell) -> Iterator[Tell]:
    """A function that other processes can call; its argument goes to ``on_message`` in a thread of this one."""
    with Listener(backlog=64) as listener:
        thread = threading.Thread(target=_hear, args=(listener, on_message), daemon=True)
        thread.start()
        try:
            yield partial(_tell, listener.address)
        finally:
            with suppress(OSError):  # the thread has ended with an error of its own
                _tell(listener.address, None)
            thread.join()


def _hear(listener: Listener, on_message: Tell) -> None:
    message: Any = ...
    with listener:
        while message is not None:
            with suppress(EOFError, OSError), listener.accept() as connection:  # a process was killed as it spoke
                message = connection.recv()
                if message is not None:
                    on_message(message)


def _tell(address: Any, message: Any) -> None:
    with Client(address) as connection:
        connection.send(message)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
