"""The cases are run in a fair order, each in a process of its own, and what was run is not run again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("numba")

from benchmarks.concealed.cases import COUNTS, list_cases
from benchmarks.concealed.children import Task, run_children
from benchmarks.concealed.order import OtherSetError, begin_set, made_cases, stratified
from benchmarks.concealed.run import Way, run_cases, way_of

ROOT = Path(__file__).resolve().parents[2]


def test_every_beginning_of_the_order_is_a_fair_sample() -> None:
    specs = stratified(list_cases(3))
    assert sorted(spec.name for spec in specs) == sorted(spec.name for spec in list_cases(3))
    for length in (20, 100, 300):
        found, total = Counter(spec.kind for spec in specs[:length]), sum(COUNTS.values())
        for kind, count in COUNTS.items():
            assert abs(found[kind] - length * count / total) <= 1
    singles = [spec.index for spec in specs if spec.kind == "single"]
    assert singles == sorted(singles)  # effects come in turn


def test_the_order_of_a_set_stays_in_its_folder(tmp_path: Path) -> None:
    specs = begin_set(tmp_path, 3, {"single": 2, "controls": 2})
    assert begin_set(tmp_path, 3, {"single": 2, "controls": 2}) == specs
    with pytest.raises(OtherSetError, match="choose another --out"):
        begin_set(tmp_path, 4, {"single": 2, "controls": 2})
    for name in ("case_000", "case_001", "case_003", ".case_002"):
        (tmp_path / "cases" / name).mkdir(parents=True)
    wanted = [spec.name for spec in specs if spec.name != "case_002"]
    assert [folder.name for folder in made_cases(tmp_path)] == wanted
    assert "single" not in json.dumps(json.loads((tmp_path / "set.json").read_text())["order"])


def good(folder: Path, out: Path) -> None:
    print("hello")
    (out / "diagnosis.json").write_text("{}")


def moody(folder: Path, out: Path) -> None:
    """Each case by its name."""
    what = folder.name
    if what == "slow":
        while True:
            pass
    if what == "waits":
        time.sleep(60)
    if what == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "error":
        raise ValueError("nothing to see")
    if what == "leaves":
        raise SystemExit(2)
    if what != "silent":
        good(folder, out)


def test_what_crashes_or_takes_too_long_costs_only_itself(tmp_path: Path) -> None:
    names = ("good", "slow", "waits", "killed", "error", "leaves", "silent", "fine")
    folders, way = [tmp_path / "cases" / name for name in names], Way("moody", moody, preload=(__name__,))
    ended = {e.task.name: e for e in run_cases(folders, tmp_path / "out", way, jobs=2, limit=3.0) if e is not None}
    assert set(ended) == set(names)
    failures = {name: e.failure for name, e in ended.items()}
    assert failures["good"] is None and failures["fine"] is None
    assert failures["slow"] == failures["waits"] == "out of time: more than 3 s"
    assert "exit code -9" in str(failures["killed"])
    assert "ValueError: nothing to see" in str(failures["error"])
    assert "exit code 2" in str(failures["leaves"])
    assert failures["silent"] == "no diagnosis.json"
    assert ended["slow"].seconds >= 3 and ended["waits"].seconds >= 9
    usage = json.loads((tmp_path / "out" / "good" / "usage.json").read_text())
    assert usage["peak_mib"] > 1 and 0 < usage["cpu_seconds"] < 3
    assert (tmp_path / "out" / "good" / "log.txt").read_text() == "hello\n"
    assert "out of time" in (tmp_path / "out" / "slow" / "failed.txt").read_text()

    again = list(run_cases(folders, tmp_path / "out", way, jobs=2))
    assert again == [None] * len(names)
    some = [folder for folder in folders if folder.name not in ("slow", "waits")]
    retried = [e.task.name for e in run_cases(some, tmp_path / "out", way, 2, retry=True) if e is not None]
    assert sorted(retried) == ["error", "killed", "leaves", "silent"]


def test_an_answer_that_no_longer_fits_is_made_anew(tmp_path: Path) -> None:
    case = tmp_path / "case_000"
    for fits, again in ((True, True), (True, False), (False, True)):
        way = Way("good", good, preload=(__name__,), fits=lambda folder, answer, fits=fits: fits)
        (ended,) = run_cases([case], tmp_path / "out", way, jobs=1)
        assert (ended is not None) is again
        assert ended is None or ended.failure is None


class Unreadable:
    """Kills the process that unpickles it."""

    def __reduce__(self) -> tuple[object, tuple[int]]:
        return os._exit, (7,)


def test_a_child_that_dies_before_it_begins_costs_only_itself(tmp_path: Path) -> None:
    early = Task("early", good, (Unreadable(),), tmp_path / "new" / "a")
    fine = Task("fine", good, (tmp_path, tmp_path), tmp_path / "b")
    ended = {e.task.name: e.failure for e in run_children([early, fine], jobs=1, limit=60.0, preload=(__name__,))}
    assert "exit code 7" in str(ended["early"])
    assert ended["fine"] is None


def note(out: Path) -> None:
    (out / "pid").write_text(str(os.getpid()))
    time.sleep(60)


def test_whoever_stops_leaves_no_process_behind(tmp_path: Path) -> None:
    tasks = [Task("quick", good, (tmp_path, tmp_path), tmp_path / "a"), Task("long", note, (tmp_path,), tmp_path / "b")]
    running = run_children(tasks, jobs=2, limit=60.0, preload=(__name__,))
    assert next(running).task.name == "quick"
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        time.sleep(0.05)
    running.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


PARENT = """
import sys
from pathlib import Path
from benchmarks.concealed.children import Task, run_children

work = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
list(run_children([Task("long", exec, (work,), Path(sys.argv[1]))], jobs=1, limit=60.0))
"""


def test_a_child_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    log = tmp_path / "log"
    parent = subprocess.Popen([sys.executable, "-c", PARENT, str(log)], cwd=ROOT)
    while not log.exists() or not log.read_text().endswith("\n"):
        assert parent.poll() is None
        time.sleep(0.05)
    child = int(log.read_text())
    parent.kill()
    parent.wait()
    for _ in range(200):
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    raise AssertionError("the child goes on")


def test_a_peer_that_is_not_there_fails_with_its_message(tmp_path: Path) -> None:
    (ended,) = run_cases([tmp_path / "case_000"], tmp_path / "out", way_of("nobody"), jobs=1)
    assert ended is not None and "pysindy, regression, sysid, gp" in str(ended.failure)
    assert "nobody" in (tmp_path / "out" / "case_000" / "failed.txt").read_text()
