"""The command line of the proof."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated

import typer
from joblib import Parallel, delayed
from rich.console import Console

from benchmarks.concealed.cases import COUNTS, make_case
from benchmarks.concealed.diagram import draw_reliability
from benchmarks.concealed.markdown import report
from benchmarks.concealed.oracle import ORACLE
from benchmarks.concealed.order import OtherSetError, begin_set, made_cases
from benchmarks.concealed.peers import WAYS as PEERS
from benchmarks.concealed.run import LIMIT, run_cases, way_of
from benchmarks.concealed.run import Way as _Way
from benchmarks.concealed.score import score_all
from torch_activegp.cli.progress import EpisodeProgress

PROOF_SEED = 2026
"""The seed of the proof: nothing is tuned on it."""

app = typer.Typer(add_completion=False)
Out = Annotated[Path, typer.Option(help="Folder of the cases, keys and results.")]
Seed = Annotated[int, typer.Option(help="Another seed is another set of cases.")]
Jobs = Annotated[int, typer.Option(help="Processes at once, each with one thread; 0: one for each core.")]
Kinds = Annotated[list[str] | None, typer.Option("--kind", help="Only these kinds; repeat it. KIND=N sets a count.")]
Limit = Annotated[int | None, typer.Option(help="Only the first N cases, a fair sample of all; more can follow later.")]
Seconds = Annotated[float, typer.Option(help="Longest time of computing for one case, s; then it has failed.")]
Retry = Annotated[bool, typer.Option("--retry", help="Run cases that have failed before once more.")]
Way = Annotated[str, typer.Option(help="diagnosis, or a peer: pysindy, regression, sysid, gp.")]


def chosen_counts(kinds: list[str] | None) -> dict[str, int]:
    """Number of cases by kind, from `single`, `two=10`, ..."""
    if not kinds:
        return dict(COUNTS)
    parts = [kind.partition("=") for kind in kinds]
    for name, _, _ in parts:
        if name not in COUNTS:
            raise typer.BadParameter(f"{name}: one of {', '.join(COUNTS)} wanted.")
    return {name: int(count) if count else COUNTS[name] for name, _, count in parts}


def processes(jobs: int) -> int:
    """How many at once."""
    return jobs or len(os.sched_getaffinity(0))


@app.callback()
def _commands() -> None:
    """The proof on concealed effects: make cases, run the diagnosis on them, fit the oracle, score with the keys."""


@app.command()
def make(out: Out, seed: Seed = PROOF_SEED, kind: Kinds = None, limit: Limit = None, jobs: Jobs = 0) -> None:
    """Write the cases and, in another folder, their keys."""
    try:
        specs = begin_set(out, seed, chosen_counts(kind))[:limit]
    except OtherSetError as error:
        raise typer.BadParameter(str(error)) from error
    with EpisodeProgress(Console(stderr=True), "making", len(specs), unit="cases") as counter:
        work = (delayed(make_case)(spec, out) for spec in specs)
        for _ in Parallel(processes(jobs), return_as="generator_unordered", batch_size=1)(work):
            counter.advance()


@app.command()
def run(
    out: Out, way: Way = "diagnosis", limit: Limit = None, jobs: Jobs = 0, seconds: Seconds = LIMIT,
    retry: Retry = False,
) -> None:  # fmt: skip
    """Diagnose every case from its files alone; cases that have a result are skipped."""
    _run(out, way_of(way), limit, jobs, seconds, retry)


@app.command()
def oracle(
    out: Out, limit: Limit = None, jobs: Jobs = 0, seconds: Seconds = LIMIT, retry: Retry = False
) -> None:  # fmt: skip
    """Fit what is true to the data of every case; the key says what that is."""
    _run(out, ORACLE, limit, jobs, seconds, retry)


def _run(out: Path, way: _Way, limit: int | None, jobs: int, seconds: float, retry: bool) -> None:
    folders, results = list(made_cases(out))[:limit], out / "results" / way.name
    console, failed = Console(stderr=True), 0
    with EpisodeProgress(console, f"running {way.name}", len(folders), unit="cases") as counter:
        for ended in run_cases(folders, results, way, processes(jobs), seconds, retry):
            counter.advance(restored=ended is None)
            if ended is not None and ended.failure is not None:
                failed += 1
                line = f"{ended.task.name}: {ended.failure.strip().splitlines()[-1]}"
                console.print(line, style="red", markup=False, highlight=False, soft_wrap=True)
    if failed:
        console.print(f"{failed} of {len(folders)} cases failed; each has a failed.txt in {results}.", soft_wrap=True)


@app.command()
def score(out: Out, way: Way = "diagnosis") -> None:
    """Open the keys, score what was run, and write the report beside the results."""
    rows, missing = score_all(out, way)
    others = {name: score_all(out, name)[0] for name in PEERS if name != way}
    text = report(
        rows, missing, f"Concealed effects: {way}", {name: theirs for name, theirs in others.items() if theirs}
    )
    folder = out / "results" / way
    folder.mkdir(parents=True, exist_ok=True)
    draw_reliability(rows, folder / "reliability.png")
    (folder / "report.md").write_text(text, encoding="utf-8")
    (folder / "scores.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(text)


@app.command(name="all")
def everything(
    out: Out, seed: Seed = PROOF_SEED, kind: Kinds = None, limit: Limit = None, jobs: Jobs = 0, way: Way = "diagnosis"
) -> None:
    """Make, run, fit the oracle, and score."""
    make(out, seed, kind, limit, jobs)
    run(out, way, limit, jobs)
    if way == "diagnosis":
        oracle(out, limit, jobs)
    score(out, way)


main = app
