from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
import torch

from torch_activegp.errors import ActiveGPError, SimulationError
from torch_activegp.experiments.workers import one_thread, run_jobs

JOBS = """
import os, signal, time
import torch
from torch_activegp.errors import SimulationError

def work(job):
    yield job, os.getpid()
    if job == "fail":
        raise SimulationError("the plant is on fire")
    if job == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if job == "sleep":
        time.sleep(100)
    if job == "wait":
        time.sleep(0.5)
    yield job, torch.get_num_threads()
    yield job, signal.getsignal(signal.SIGINT) == signal.SIG_IGN
"""


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A module that worker processes can import."""
    (tmp_path / "jobs_of_a_test.py").write_text(JOBS)
    monkeypatch.syspath_prepend(tmp_path)
    yield import_module("jobs_of_a_test")
    sys.modules.pop("jobs_of_a_test")


def test_one_thread_is_put_back() -> None:
    before = torch.get_num_threads()
    with one_thread():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before


@pytest.mark.parametrize(("names", "processes"), [([], 2), (["a"], 2), (["a", "b", "c"], 1)])
def test_one_process_is_this_one(jobs: ModuleType, names: list[str], processes: int) -> None:
    ours = signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    heard: list[object] = []
    messages = run_jobs(jobs.work, names, processes, heard.append)
    assert messages == {name: [(name, os.getpid()), (name, 1), (name, ours)] for name in names}
    assert heard == [message for name in names for message in messages[name]]


def test_several_share_the_jobs_on_one_thread_each_and_end(jobs: ModuleType, alive: Callable[[int], bool]) -> None:
    heard: list[tuple[str, object]] = []
    messages = run_jobs(jobs.work, ["wait", "a", "b"], 2, heard.append)
    pids = {told[0][1] for told in messages.values()}
    assert os.getpid() not in pids
    assert 1 <= len(pids) <= 2
    assert {job: told[1:] for job, told in messages.items()} == {job: [(job, 1), (job, True)] for job in messages}
    assert {job: [message for message in heard if message[0] == job] for job in ("wait", "a", "b")} == messages
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert not any(map(alive, pids))


def test_messages_come_at_once_and_an_error_ends_the_others(jobs: ModuleType, alive: Callable[[int], bool]) -> None:
    heard: list[tuple[str, int]] = []
    with pytest.raises(SimulationError, match="^the plant is on fire$"):
        run_jobs(jobs.work, ["sleep", "fail"], 2, heard.append)
    assert "fail" in dict(heard)
    assert not any(alive(pid) for _, pid in heard)


def test_a_killed_process_is_one_message_that_says_what_to_do_also_in_a_thread(
    jobs: ModuleType, alive: Callable[[int], bool]
) -> None:
    heard: list[tuple[str, int]] = []
    errors: list[ActiveGPError] = []

    def run() -> None:
        try:
            run_jobs(jobs.work, ["killed", "sleep"], 2, heard.append)
        except ActiveGPError as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(timeout=60)
    assert "was killed, as happens when memory runs out. Use fewer --jobs; --resume keeps" in str(errors)
    assert not any(alive(pid) for _, pid in heard)
