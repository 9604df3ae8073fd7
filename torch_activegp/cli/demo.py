"""``torch-activegp demo``: a concealed effect, found."""

from __future__ import annotations

import dataclasses
import secrets
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from torch_activegp.cli.app import app, console, results
from torch_activegp.cli.diagnose import _effects, _errors
from torch_activegp.cli.folders import check_free, next_free, results_in
from torch_activegp.cli.options import Threads, place
from torch_activegp.cli.progress import StageProgress, show_time
from torch_activegp.data import load_recordings
from torch_activegp.experiments.demo import RATE, RUNS, SECONDS, TESTS, Secret, score, write_demo
from torch_activegp.experiments.output import write_json
from torch_activegp.experiments.workers import one_thread
from torch_activegp.report import write_report


@app.command()
def demo(
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Decides on what is hidden, how much of it, controls and noise. Otherwise by chance."),
    ] = None,
    threads: Threads = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            parser=place,
            help="Output folder: new or empty. By default runs/demo, the next free one.",
            metavar="FOLDER",
        ),
    ] = None,
) -> None:
    """Hide an effect in a pendulum's recordings, diagnose them, and open the key afterwards.

    Example:  `torch-activegp demo`

    The pendulum's model leaves out one of eight effects, or none: friction, drag, a spring, a constant torque; a motor
    that is weak, late or clipped. The recordings come from other code than the diagnosis, which is told nothing.

    Writes the model and its recordings, the diagnosis with report.html, and key.json.
    """
    began = time.perf_counter()
    seed = secrets.randbelow(1_000_000) if seed is None else seed
    folder = out or next_free(Path("runs") / "demo")
    check_free(folder, ["*"])
    with results_in(folder):
        secret = write_demo(folder, seed)
    _say(
        f"Seed {seed}: {folder} holds model.xml, {RUNS} recordings of {SECONDS:g} s at {RATE} Hz and {TESTS} held out. "
        "What the model leaves out, the diagnosis is not told.",
        to=console,
    )
    fit, test = (load_recordings(str(folder / pattern)) for pattern in ("run*.csv", "test*.csv"))
    from torch_activegp.diagnosis import diagnose

    with one_thread(), StageProgress(console, "diagnosing") as progress:
        diagnosis = diagnose(folder / "model.xml", fit, test, nthread=threads, tell=progress.tell)
    found = diagnosis.to_dict()
    with results_in(folder):
        diagnosis.save(folder)
        write_report(found, diagnosis.evidence, folder / "report.html")
        write_json(folder / "key.json", {"seed": seed, **dataclasses.asdict(secret)})
    _say(diagnosis.sentence)
    _show(found, secret, seed)
    _say(f"Done in {show_time(time.perf_counter() - began)}. See {folder / 'report.html'}.")


def _show(found: Mapping[str, Any], secret: Secret, seed: int) -> None:
    effects: Sequence[Mapping[str, Any]] = found.get("effects") or []
    if effects:
        results.print(_effects(effects))
    _say(f"Hidden was {secret} (seed {seed}). {score(secret, found)}")
    _say("Free run and one step on the held-out recordings, in standard deviations of what was measured:")
    results.print(_errors(found["fit"]["holdout"], corrected=bool(effects)))


def _say(text: str, to: Any = results) -> None:
    to.print(text, highlight=False, markup=False, soft_wrap=True)
