"""The command line of the proof."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from joblib import Parallel, delayed
from rich.console import Console

from benchmarks.concealed.cases import COUNTS, list_cases, make_case
from benchmarks.concealed.markdown import report
from benchmarks.concealed.run import attempt
from benchmarks.concealed.score import score_all
from torch_activegp.cli.progress import EpisodeProgress

PROOF_SEED = 2026
"""The seed of the proof: nothing is tuned on it."""

app = typer.Typer(add_completion=False)
Out = Annotated[Path, typer.Option(help="Folder of the cases, keys and results.")]
Seed = Annotated[int, typer.Option(help="Another seed is another set of cases.")]
Jobs = Annotated[int, typer.Option(help="Processes side by side.")]
Kinds = Annotated[list[str] | None, typer.Option("--kind", help="Only these kinds; repeat it. KIND=N sets a count.")]
Limit = Annotated[int | None, typer.Option(help="Only the first N cases.")]

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


@app.callback()
def _commands() -> None:
    """The proof on concealed effects: make cases, run the diagnosis on them, score it with the keys."""


@app.command()
def make(out: Out, seed: Seed = PROOF_SEED, kind: Kinds = None, limit: Limit = None, jobs: Jobs = 2) -> None:
    """Write the cases and, in another folder, their keys."""
    specs = list_cases(seed, chosen_counts(kind))[:limit]
    with EpisodeProgress(Console(stderr=True), "making", len(specs), unit="cases") as counter:
        work = (delayed(make_case)(spec, out) for spec in specs)
        for _ in Parallel(jobs, return_as="generator_unordered")(work):
            counter.advance()


@app.command()
def run(out: Out, way: Way = "diagnosis", limit: Limit = None, jobs: Jobs = 2) -> None:
    """Diagnose every case from its files alone; cases that have a result are skipped."""
    folders = sorted(path for path in (out / "cases").iterdir() if path.is_dir())[:limit]
    console, failed = Console(stderr=True), 0
    with EpisodeProgress(console, f"running {way}", len(folders), unit="cases") as counter:
        work = (delayed(attempt)(folder, out / "results" / way / folder.name, way) for folder in folders)
        for message in Parallel(jobs, return_as="generator_unordered")(work):
            counter.advance()
            if message:
                failed += 1
                console.print(message, style="red", markup=False, highlight=False)
    if failed:
        console.print(f"{failed} of {len(folders)} cases failed; each has a failed.txt in {out / 'results' / way}.")


@app.command()
def score(out: Out, way: Way = "diagnosis") -> None:
    """Open the keys, score what was run, and write the report beside the results."""
    rows, missing = score_all(out, way)
    text = report(rows, missing, f"Concealed effects: {way}")
    folder = out / "results" / way
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.md").write_text(text, encoding="utf-8")
    (folder / "scores.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(text)


@app.command(name="all")
def everything(
    out: Out, seed: Seed = PROOF_SEED, kind: Kinds = None, limit: Limit = None, jobs: Jobs = 2, way: Way = "diagnosis"
) -> None:
    """Make, run and score."""
    make(out, seed, kind, limit, jobs)
    run(out, way, limit, jobs)
    score(out, way)


main = app
