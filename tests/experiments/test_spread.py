from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from torch_activegp.errors import ActiveGPError, ConfigurationError, SimulationError
from torch_activegp.experiments.spread import spread

Tell = Callable[[Any], None]
ITEMS = {name: np.full(200_000, float(index)) for index, name in enumerate("abc")}
"""Larger than what joblib and Ray share between processes without copies, which cannot be written to."""


def work(name: str, item: Any, tell: Tell) -> dict[str, Any]:
    """Says where it runs, and writes to what it got. Pickled by value where tests are no modules."""
    tell((name, "begun"))
    item += 1
    return {
        "pid": os.getpid(),
        "threads": (torch.get_num_threads(), os.environ.get("OMP_NUM_THREADS")),
        "folder": os.getcwd(),
        "item": item,
    }


def check(found: dict[str, Any], folder: Path) -> None:
    assert set(found) == set(ITEMS)
    assert os.getpid() not in {one["pid"] for one in found.values()}
    assert {one["threads"] for one in found.values()} == {(1, "1")}
    assert {one["folder"] for one in found.values()} == {str(folder)}
    for index, name in enumerate(ITEMS):
        found[name]["item"] += 1  # can be written to
        assert found[name]["item"][0] == index + 2
        assert ITEMS[name][0] == index


@pytest.fixture
def by_value() -> Iterator[None]:
    """Workers cannot import a test: its functions travel as a whole."""
    import cloudpickle

    module = sys.modules[__name__]
    cloudpickle.register_pickle_by_value(module)
    yield
    cloudpickle.unregister_pickle_by_value(module)


@pytest.mark.parametrize(("items", "jobs"), [({}, 2), ({"a": 1}, 2), ({"a": 1, "b": 2}, 1)])
def test_one_worker_is_this_process(items: dict[str, int], jobs: int) -> None:
    heard: list[Any] = []

    def where(name: str, item: int, tell: Tell) -> tuple[int, int, int]:
        tell(name)
        return item, os.getpid(), torch.get_num_threads()

    assert list(spread(where, items, jobs, tell=heard.append)) == [
        (name, (item, os.getpid(), 1)) for name, item in items.items()
    ]
    assert heard == list(items)


def test_results_come_as_they_are_ready_and_an_iterator_that_is_closed_ends_the_workers() -> None:
    done: list[str] = []

    def note(name: str, item: int, tell: Tell) -> int:
        done.append(name)
        return item

    results = spread(note, {"a": 1, "b": 2}, 1)
    assert (next(results), done) == (("a", 1), ["a"])
    results.close()
    assert done == ["a"]


def test_processes_have_one_thread_our_folder_and_arrays_of_their_own(
    by_value: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, alive: Callable[[int], bool]
) -> None:
    monkeypatch.chdir(tmp_path)
    heard: list[Any] = []
    found = dict(spread(work, ITEMS, 2, tell=heard.append))
    check(found, tmp_path)
    assert sorted(heard) == [(name, "begun") for name in ITEMS]
    assert not any(alive(one["pid"]) for one in found.values())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_is_left_to_this_process(by_value: None) -> None:
    def ignores(name: str, item: Any, tell: Tell) -> bool:
        return signal.getsignal(signal.SIGINT) == signal.SIG_IGN

    assert dict(spread(ignores, {"a": 1, "b": 2}, 2)) == {"a": True, "b": True}


def test_messages_come_at_once_and_an_error_ends_the_others(by_value: None, alive: Callable[[int], bool]) -> None:
    def fail(name: str, item: Any, tell: Tell) -> None:
        tell((name, os.getpid()))
        if name == "fail":
            raise SimulationError("the plant is on fire")
        time.sleep(100)

    heard: list[tuple[str, int]] = []
    with pytest.raises(SimulationError, match="^the plant is on fire$"):
        list(spread(fail, {"sleep": 1, "fail": 2}, 2, tell=heard.append))
    assert "fail" in dict(heard)
    assert not any(alive(pid) for _, pid in heard)


def test_a_killed_worker_is_one_message_also_in_a_thread(by_value: None, alive: Callable[[int], bool]) -> None:
    def kill(name: str, item: Any, tell: Tell) -> None:
        tell(os.getpid())
        if name == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(100)

    heard: list[int] = []
    errors: list[ActiveGPError] = []

    def run() -> None:
        try:
            list(spread(kill, {"kill": 1, "sleep": 2}, 2, tell=heard.append))
        except ActiveGPError as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(timeout=60)
    assert "was killed, as happens when memory runs out. Use fewer jobs" in str(errors)
    assert not any(map(alive, heard))


def test_what_cannot_be_sent_is_named_before_anything_is_done() -> None:
    items = {"a": 1, "arm": (number for number in range(3))}
    with pytest.raises(ConfigurationError, match="arm: cannot be sent to another process .*Give files in place of"):
        list(spread(print, items, 2))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"jobs": -1}, "jobs: 0 for each core, or a positive number wanted, found -1"),
        ({"backend": "dask"}, "backend: one of loky, ray wanted, found 'dask'"),
    ],
)
def test_arguments_out_of_range_are_refused_at_once(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        spread(work, ITEMS, **arguments)


def test_ray_that_is_not_installed_is_one_message_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'torch-activegp\[ray\]'; or use backend loky"):
        spread(work, ITEMS, backend="ray")


class FakeRay:
    """A Ray that cannot be reached, or that has one CPU."""

    class exceptions:  # noqa: N801
        RayActorError = OSError

    def __init__(self, error: Exception | None = None) -> None:
        self.error = error
        self.ended = 0

    def is_initialized(self) -> bool:
        return False

    def init(self, **options: Any) -> None:
        if self.error is not None:
            raise self.error

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 1.0}

    def shutdown(self) -> None:
        self.ended += 1


def test_a_ray_that_cannot_be_reached_is_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", FakeRay(ConnectionError("nobody at 10.0.0.1")))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    with pytest.raises(ConfigurationError, match=r"nobody at 10.0.0.1. Check RAY_ADDRESS, or use backend loky"):
        list(spread(work, ITEMS, backend="ray"))


def test_a_ray_of_one_cpu_is_this_process_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    ray = FakeRay()
    monkeypatch.setitem(sys.modules, "ray", ray)
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    assert dict(spread(lambda name, item, tell: os.getpid(), {"a": 1, "b": 2}, backend="ray")) == dict.fromkeys(
        "ab", os.getpid()
    )
    assert ray.ended == 1


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ray") is None, reason="needs Ray: pip install 'torch-activegp[ray]'")
def test_a_local_ray(by_value: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two CPUs: with one, joblib works in this process."""
    import ray

    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.chdir(tmp_path)
    ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    try:
        check(dict(spread(work, ITEMS, 8, backend="ray")), tmp_path)
        assert ray.is_initialized()  # it was the user's
        kill = {"a": 1, "b": 2}
        with pytest.raises(ActiveGPError, match="A worker process was killed"):
            list(spread(lambda name, item, tell: os.kill(os.getpid(), signal.SIGKILL), kill, backend="ray"))
    finally:
        ray.shutdown()
