from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import closing
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
import torch

from torch_activegp.errors import ActiveGPError, SimulationError
from torch_activegp.experiments import workers
from torch_activegp.experiments.workers import one_thread, run_jobs

JOBS = """
import os, signal, time
import torch
from torch_activegp.errors import SimulationError

def work(job):
    yield os.getpid()
    if job == "fail":
        raise SimulationError("the plant is on fire")
    if job == "die":
        os._exit(3)
    if job == "sleep":
        time.sleep(100)
    yield torch.get_num_threads()
    yield signal.getsignal(signal.SIGINT) == signal.SIG_IGN
"""


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A module that worker processes can import."""
    (tmp_path / "jobs_of_a_test.py").write_text(JOBS)
    monkeypatch.syspath_prepend(tmp_path)
    yield import_module("jobs_of_a_test")


def told(module: ModuleType, jobs: list[str], processes: int) -> dict[str, list[object]]:
    messages: dict[str, list[object]] = {job: [] for job in jobs}
    for job, message in run_jobs(module.work, jobs, processes):
        messages[job].append(message)
    return messages


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_one_thread_is_put_back() -> None:
    before = torch.get_num_threads()
    with one_thread():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before


@pytest.mark.parametrize("names", [[], ["a"], ["a", "b", "c"]])
def test_one_process_is_this_one(jobs: ModuleType, names: list[str]) -> None:
    ours = signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    assert told(jobs, names, 1) == {name: [os.getpid(), 1, ours] for name in names}


def test_several_share_the_jobs_on_one_thread_each_and_end(jobs: ModuleType) -> None:
    messages = told(jobs, ["a", "b", "c"], 2)
    pids = {pid for pid, *_ in messages.values()}
    assert len(pids) == 2
    assert os.getpid() not in pids
    assert all(rest == [1, True] for _, *rest in messages.values())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert not any(map(alive, pids))


@pytest.fixture
def quick_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that need not import torch again."""
    monkeypatch.setattr(workers, "_START", "fork")


def test_an_error_of_ours_comes_back_and_the_others_end(jobs: ModuleType, quick_start: None) -> None:
    pids = []
    with pytest.raises(SimulationError, match="the plant is on fire"):
        for _, pid in run_jobs(jobs.work, ["sleep", "fail"], 2):
            pids.append(pid)
    assert not any(map(alive, pids))


def test_a_death_is_reported(jobs: ModuleType, quick_start: None) -> None:
    with pytest.raises(ActiveGPError, match=r"for die died \(exit code 3; .*--resume"):
        list(run_jobs(jobs.work, ["die", "sleep"], 2))
    assert multiprocessing.active_children() == []


def test_leaving_early_ends_the_processes_also_from_a_thread(jobs: ModuleType, quick_start: None) -> None:
    pids = []

    def leave_early() -> None:
        with closing(run_jobs(jobs.work, ["sleep", "sleep too"], 2)) as messages:
            pids.append(next(messages)[1])

    thread = threading.Thread(target=leave_early)
    thread.start()
    thread.join()
    assert not alive(pids[0])


def test_what_a_worker_says(jobs: ModuleType) -> None:
    ours, theirs = multiprocessing.Pipe()

    def serve() -> None:
        with one_thread():
            workers._worker(jobs.work, theirs)

    thread = threading.Thread(target=serve)
    thread.start()
    for job, wanted in (("a", ["message", "message", "message", "done"]), ("fail", ["message", "error"])):
        ours.send(job)
        assert [ours.recv()[0] for _ in wanted] == wanted
    ours.close()  # as when the parent was killed
    thread.join(timeout=10)
    assert not thread.is_alive()


def test_a_worker_stops_working_when_its_parent_is_gone() -> None:
    ours, theirs = multiprocessing.Pipe()
    ours.send("job")
    done = []

    def work(job: str) -> Iterator[int]:
        ours.close()
        for index in range(3):
            yield index
            done.append(index)

    with one_thread():
        workers._worker(work, theirs)
    assert done == []
