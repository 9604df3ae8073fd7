"""The diagnosis, or a peer, on every case from its files alone."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

from benchmarks.concealed.children import Ended, Task, run_children

LIMIT = 600.0
"""Longest time for one case, s of computing."""


@dataclasses.dataclass(frozen=True)
class Way:
    """Something that is done with every case.

    Args:
        name: of its folder among the results.
        work: takes the folder of a case and an empty one, where it writes.
        answer: the file without which it has failed.
        preload: slow modules that it imports.
        fits: whether an answer, a file, still fits the case, a folder.
    """

    name: str
    work: Callable[[Path, Path], None]
    answer: str = "diagnosis.json"
    preload: tuple[str, ...] = ()
    fits: Callable[[Path, Path], bool] = lambda folder, answer: True


def way_of(name: str) -> Way:
    """The diagnosis, or a peer by its name."""
    if name == "diagnosis":
        return Way(name, diagnose_case, preload=("torch_activegp.cli.diagnose", "torch_activegp.diagnosis"))
    return Way(name, partial(peer_case, name), preload=("benchmarks.concealed.peers.recorded",))


def diagnose_case(folder: Path, out: Path) -> None:
    """Diagnose one case through the command line, in one thread."""
    from torch_activegp.cli import app

    train, test = sorted(folder.glob("train_*.csv")), sorted(folder.glob("test_*.csv"))
    held_out = [part for path in test for part in ("--holdout", str(path))]
    app(["diagnose", str(folder / "model.xml"), *map(str, train), *held_out, "--out", str(out), "--threads", "1"])


def peer_case(name: str, folder: Path, out: Path) -> None:
    """One of the peers on one case."""
    from benchmarks.concealed.peers import run_peer

    run_peer(name, folder, out)


def run_cases(
    folders: Iterable[Path], results: Path, way: Way, jobs: int, limit: float = LIMIT, retry: bool = False
) -> Iterator[Ended | None]:
    """Run each case and give how it ended, or None for one that was run before.

    Args:
        folders: of the cases, in order.
        results: where each gets its folder, whole or not at all.
        way: what is done.
        jobs: processes at once.
        limit: longest time of computing for one case, s.
        retry: whether cases that failed before are run again.
    """
    tasks = []
    for folder in folders:
        answer = results / folder.name / way.answer
        if is_done(answer.parent, way.answer, retry) and (not answer.exists() or way.fits(folder, answer)):
            yield None
            continue
        unfinished = results / f".{folder.name}"
        shutil.rmtree(unfinished, ignore_errors=True)
        tasks.append(Task(folder.name, way.work, (folder, unfinished), unfinished / "log.txt"))
    for ended in run_children(tasks, jobs, limit, way.preload):
        if ended.failure is None and not ended.task.log.with_name(way.answer).exists():
            ended = dataclasses.replace(ended, failure=f"no {way.answer}")
        keep(ended, results)
        yield ended


def is_done(result: Path, answer: str, retry: bool) -> bool:
    """Whether a case was run: it has an answer, or it failed and is not to be run again."""
    return (result / answer).exists() or (not retry and (result / "failed.txt").exists())


def digest(path: Path) -> str | None:
    """Of a file, if it is there."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else None


def keep(ended: Ended, results: Path) -> None:
    """Put what a case left among the results, with `usage.json`, and with `failed.txt` where it failed."""
    unfinished, final = ended.task.log.parent, results / ended.task.name
    usage = {"seconds": ended.seconds, "cpu_seconds": ended.cpu, "peak_mib": ended.peak}
    (unfinished / "usage.json").write_text(json.dumps(usage) + "\n", encoding="utf-8")
    if ended.failure is not None:
        (unfinished / "failed.txt").write_text(ended.failure + "\n", encoding="utf-8")
    shutil.rmtree(final, ignore_errors=True)
    unfinished.rename(final)
