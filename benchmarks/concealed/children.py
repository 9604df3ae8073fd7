"""Work in processes of its own, several at once: what crashes or takes too long costs only itself.

Each process is forked from one server that has imported the slow modules before.
"""

from __future__ import annotations

import dataclasses
import math
import multiprocessing
import os
import resource
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

Work = Callable[..., None]

PATIENCE = 3.0


@dataclasses.dataclass(frozen=True)
class Task:
    """A function of a module and its arguments, all of which can be pickled; what it prints goes to the log."""

    name: str
    work: Work
    arguments: tuple[Any, ...]
    log: Path


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a task ended: seconds on the clock, seconds of computing and most memory in MiB (None where the process was
    killed), and what went wrong.
    """

    task: Task
    seconds: float
    cpu: float | None
    peak: float | None
    failure: str | None


@dataclasses.dataclass(frozen=True)
class _Child:
    task: Task
    process: Any
    report: Connection
    started: float

    def end(self, limit: float, overdue: bool) -> Ended:
        """Let go of a process that has ended, or end it."""
        seconds = time.monotonic() - self.started
        if overdue:
            self.process.kill()
        self.process.join()
        cpu = peak = failure = None
        with suppress(EOFError, OSError):
            cpu, peak = self.report.recv() if self.report.poll() else (None, None)
        if overdue or self.process.exitcode == -signal.SIGXCPU:
            failure = f"out of time: more than {limit:g} s"
        elif self.process.exitcode:
            tail = self.task.log.read_text(encoding="utf-8", errors="replace")[-3000:]
            failure = f"exit code {self.process.exitcode}\n{tail}"
        return Ended(self.task, seconds, cpu, peak, failure)


def run_children(tasks: Iterable[Task], jobs: int, limit: float, preload: Sequence[str] = ()) -> Iterator[Ended]:
    """Do tasks side by side and give each as it ends; those that run are killed when the caller stops.

    Args:
        tasks: in this order.
        jobs: processes at once.
        limit: longest time of computing for one, s; on the clock it may take PATIENCE times as long, as beside others.
        preload: modules that the server imports before it forks.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, *preload])
    waiting, running = deque(tasks), dict[int, _Child]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                child = _start(context, waiting.popleft(), limit)
                running[child.process.sentinel] = child
            now = time.monotonic()
            left = min(child.started + PATIENCE * limit - now for child in running.values())
            ready = wait(list(running), timeout=max(left, 0.0))
            for sentinel, child in list(running.items()):
                overdue = sentinel not in ready and time.monotonic() - child.started > PATIENCE * limit
                if sentinel in ready or overdue:
                    del running[sentinel]
                    yield child.end(limit, overdue)
    finally:
        for child in running.values():
            child.process.kill()
            child.process.join()


def _start(context: Any, task: Task, limit: float) -> _Child:
    report, tell = context.Pipe()
    task.log.parent.mkdir(parents=True, exist_ok=True)
    task.log.write_bytes(b"")  # there to be read, however early the process dies
    process = context.Process(target=_work, args=(task, tell, limit), daemon=True)
    process.start()
    tell.close()
    return _Child(task, process, report, time.monotonic())


def _work(task: Task, tell: Connection, limit: float) -> None:
    """Do a task in this process, with all output in its log."""
    log = os.open(task.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit), math.ceil(limit) + 5))
    threading.Thread(target=_leave_with_parent, args=(tell,), daemon=True).start()
    code = 0
    try:
        task.work(*task.arguments)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    tell.send((usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024))
    os._exit(code)


def _leave_with_parent(parent: Connection) -> None:
    """End this process when the one that asked for it has ended, in whatever way."""
    with suppress(EOFError, OSError):
        parent.recv()
    os._exit(1)
