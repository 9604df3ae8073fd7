"""Worker processes that report as they go and are gone afterwards, whatever happens."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

import torch

from torch_activegp.errors import ActiveGPError

_START = "spawn"
"""How processes start; a forked torch may hang."""

Work = Callable[[Any], Iterator[Any]]
"""From a job to what it has to tell; both can be pickled."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch on one thread: faster for small matrices beside other processes, and the same bits in each of them."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def run_jobs(work: Work, jobs: Sequence[Any], num_processes: int) -> Generator[tuple[Any, Any]]:
    """Do independent jobs side by side.

    Every job computes on one thread of torch, so its result does not depend on the number of processes. Leaving the
    iteration early, also by an error or by Ctrl-C, ends the processes at once; so does the death of this one.

    Args:
        work: called with each job.
        jobs: what to do, in this order.
        num_processes: how many at once; with one, everything happens in this process.

    Yields:
        A job and one thing that it told, as it comes.

    Raises:
        ActiveGPError: what a job raised, or a process died.
    """
    if min(num_processes, len(jobs)) <= 1:
        for job in jobs:
            with one_thread():
                yield from ((job, message) for message in work(job))
        return
    pool = [_start(work) for _ in range(min(num_processes, len(jobs)))]
    try:
        yield from _serve(pool, list(jobs))
    finally:
        for process, connection in pool:
            process.kill()
            process.join()
            connection.close()


def _start(work: Work) -> tuple[BaseProcess, Connection]:
    context: Any = multiprocessing.get_context(_START)
    ours, theirs = context.Pipe()
    process = context.Process(target=_worker, args=(work, theirs), daemon=True)
    with _interrupts_ignored():  # a child inherits this, so Ctrl-C reaches only the parent, which ends the children
        process.start()
    theirs.close()
    return process, ours


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


def _serve(pool: Sequence[tuple[BaseProcess, Connection]], jobs: list[Any]) -> Iterator[tuple[Any, Any]]:
    processes: dict[Any, BaseProcess] = {connection: process for process, connection in pool}
    busy: dict[Any, Any] = {}
    for connection in processes:
        busy[connection] = jobs.pop(0)
        connection.send(busy[connection])
    while busy:
        ready: list[Any] = wait(list(busy))
        for connection in ready:
            try:
                kind, message = connection.recv()
            except (EOFError, ConnectionError) as error:
                processes[connection].join()
                raise ActiveGPError(
                    f"The worker process for {busy[connection]} died (exit code {processes[connection].exitcode}; -9 "
                    "often means that memory ran out). Use fewer --jobs; --resume keeps what is complete."
                ) from error
            if kind == "error":
                raise message
            if kind == "message":
                yield busy[connection], message
            elif jobs:
                busy[connection] = jobs.pop(0)
                connection.send(busy[connection])
            else:
                del busy[connection]


def _worker(work: Work, connection: Connection) -> None:
    torch.set_num_threads(1)
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        try:
            for message in work(job):
                connection.send(("message", message))
            connection.send(("done", None))
        except BrokenPipeError:  # the parent is gone
            return
        except ActiveGPError as error:
            connection.send(("error", error))
