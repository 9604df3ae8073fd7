"""``torch-activegp diagnose``: what is missing in a simulator, and how much of it."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import typer
from rich.table import Table

from torch_activegp.cli.app import INTERRUPTED, app, console, results
from torch_activegp.cli.folders import check_free, next_free, results_in
from torch_activegp.cli.models import find_model
from torch_activegp.cli.options import RECORDINGS, Columns, Holdout, Model, Seed, Threads, output_folder, place
from torch_activegp.cli.progress import StageProgress, show_time
from torch_activegp.experiments.output import write_json
from torch_activegp.experiments.recorded import fitted_by_mistake, load_apart
from torch_activegp.experiments.workers import one_thread
from torch_activegp.report import write_report
from torch_activegp.report.numbers import MISSING, estimate, is_number, number, percent, unit_text
from torch_activegp.report.words import listed, only_closest

if TYPE_CHECKING:
    from torch_activegp.diagnosis import Checkpoint

_PROGRESS, _LAST = ".progress", "settings.json"
"""What is kept of an unfinished diagnosis; the file that is written last."""
_RESULTS = (_LAST, "diagnosis.json", "evidence.json", "report.html", "corrected*", "learned.pt", "next.csv")
FORECASTS = {"one_step": "one step (0.1 s)", "free_run": "free run"}

Values = Mapping[str, Any]


@app.command()
def diagnose(
    model: Model,
    recordings: Annotated[list[str], typer.Argument(help=f"To diagnose: {RECORDINGS}", metavar="RECORDING...")],
    holdout: Holdout = None,
    columns: Columns = None,
    seed: Seed = 0,
    threads: Threads = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            parser=place,
            help="Output folder, without results of an earlier run. By default runs/diagnose-MODEL, the next free one.",
            metavar="DIR",
        ),
    ] = None,
) -> None:
    """Find out whether a simulator is wrong, where, which physics was left out, and how much of it.

    Example:  `torch-activegp diagnose emps emps:train --holdout emps:test`

    Your own:  `torch-activegp diagnose arm.xml run1.csv run2.csv --holdout run3.csv`

    In torch:  `torch-activegp diagnose package.module:factory run1.csv run2.csv --holdout run3.csv`

    Positions are enough. The verdict comes first; then the effects with their share of the mismatch, their probability
    against every rival, and their parameters with 95 % intervals; then the errors on the held-out recordings before and
    after the correction, in standard deviations of what was measured. On a simulator in torch, effects act as
    accelerations, and its time step must fit the recordings.

    Writes diagnosis.json, report.html (one file, needs no network), corrected.xml (where MJCF can hold the effects;
    not for a simulator in torch), corrected.pt (where it cannot hold them all) and learned.pt (with a learned force),
    both for `evaluate` and Python, next.csv (controls that would tell rivals apart) and settings.json. After an
    interruption the same command goes on from its last finished stage.
    """
    began = time.perf_counter()
    settings = {
        "command": "diagnose",
        "model": model,
        "recordings": recordings,
        "holdout": holdout or [],
        "columns": None if columns is None else str(columns),
        "seed": seed,
    }
    name = Path(model).stem if Path(model).is_file() else model
    usual = output_folder(None, "diagnose", name)
    folder = out or next_free(usual, _is_unfinished)
    check_free(folder, [_LAST] if _is_unfinished(folder) else _RESULTS)
    simulator = find_model(model)
    fit, test = load_apart(recordings, holdout or [], columns)
    if mistake := fitted_by_mistake(recordings, holdout or []):
        _say(mistake, to=console)
    from torch_activegp.diagnosis import Checkpoint
    from torch_activegp.diagnosis import diagnose as diagnose_from
    from torch_activegp.diagnosis.checkpoint import kept

    def kept_in(key: str) -> Path:
        own = out or next_free(usual, lambda path: _is_unfinished(path) and kept(path / _PROGRESS)[0] == key)
        return own / _PROGRESS

    checkpoint = Checkpoint(kept_in)
    with _going_on(checkpoint):
        with one_thread(), _Told.at_once() as told, StageProgress(console, "diagnosing") as progress:
            tell = _resuming(progress.tell, checkpoint)
            diagnosis = diagnose_from(
                simulator, fit, test, seed=seed, nthread=threads, tell=tell, checkpoint=checkpoint
            )
        found = diagnosis.to_dict()
        assert checkpoint.path is not None
        folder = checkpoint.path.parent
        if (folder / _LAST).exists():  # another call with the same --out was done first
            folder = next_free(folder)
        with results_in(folder):
            diagnosis.save(folder)
            write_report(found, diagnosis.evidence, folder / "report.html")
            write_json(folder / _LAST, {**settings, "seconds": round(time.perf_counter() - began, 2)})
            checkpoint.clear()
    _say(diagnosis.sentence)
    _show(found)
    later = [note for note in found.get("notes") or () if note not in told.notes]
    for note in [*later, *([mistake] if mistake else [])]:
        _say(note, to=console)
    names = sorted({path.name for pattern in _RESULTS for path in folder.glob(pattern)})
    _say(f"Done in {show_time(time.perf_counter() - began)}. {folder} holds {', '.join(names)}.")
    _say(f"See {folder / 'report.html'}.")


def _is_unfinished(folder: Path) -> bool:
    """Whether a diagnosis was interrupted there."""
    return (folder / _PROGRESS).is_file() and not (folder / _LAST).exists()


@contextmanager
def _going_on(checkpoint: Checkpoint) -> Iterator[None]:
    """Say after Ctrl-C how the diagnosis goes on."""
    try:
        yield
    except KeyboardInterrupt as error:
        if checkpoint.stage is None or checkpoint.path is None:
            raise
        _say(
            f"Interrupted. {checkpoint.path.parent} keeps what is done: the same command goes on from there.",
            to=console,
        )
        raise typer.Exit(INTERRUPTED) from error


def _resuming(tell: Callable[[str, float], None], checkpoint: Checkpoint) -> Callable[[str, float], None]:
    """The same, and says once, as soon as it is known, that an interrupted call goes on."""
    said: list[str] = []

    def wrapped(stage: str, done: float) -> None:
        if checkpoint.resumed is not None and not said:
            said.append(f"Going on from an interrupted call: {checkpoint.resumed} is done.")
            _say(said[-1], to=console)
        tell(stage, done)

    return wrapped


class _Told(logging.Handler):
    """Says what the diagnosis logs when it does so, and remembers it."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.notes: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Say it."""
        self.notes.append(record.getMessage())
        _say(self.notes[-1], to=console)

    @classmethod
    @contextmanager
    def at_once(cls) -> Iterator[Self]:
        """Listen while the context is."""
        logger, told = logging.getLogger("torch_activegp.diagnosis.diagnose"), cls()
        logger.addHandler(told)
        before, logger.propagate = logger.propagate, False
        try:
            yield told
        finally:
            logger.removeHandler(told)
            logger.propagate = before


def _say(text: str, to: Any = results) -> None:
    to.print(text, highlight=False, markup=False, soft_wrap=True)


def _show(found: Values) -> None:
    _show_effects(found)
    rest = (found.get("unexplained") or {}).get("share")
    if is_number(rest) and found.get("verdict") != "none":
        closest = "Nothing explains it; the effects that come closest leave"
        lead = closest if only_closest(found, rest) else "Not explained:"
        _say(f"{lead} {percent(rest)} of the mismatch.")
    held_out = (found.get("fit") or {}).get("holdout") or {}
    if any(held_out.get(key) for key in FORECASTS):
        _say("Errors on held-out recordings, in standard deviations of what was measured:")
        results.print(_errors(held_out, corrected=bool(found.get("effects"))))
    following = found.get("next_experiment")
    if following:
        controls = f" Controls: {following['controls']}." if following.get("controls") else ""
        _say(f"Next recording: {following.get('why') or ''}{controls}")


def _show_effects(found: Values) -> None:
    effects = found.get("effects") or []
    if effects:
        results.print(_effects(effects))
    for effect in effects:
        if effect.get("ties"):
            rivals = listed((_named(tie) for tie in effect["ties"]), "or")
            _say(f"Tie: {_named(effect)} cannot be told from {rivals} by these recordings.")
    along = found.get("retuned") or []
    if along:
        _say(f"Fitted along and not named: {listed(map(_named, along))}.")
    stable = found.get("stability")
    if stable:
        _say(stable["sentence"])


def _named(effect: Values) -> str:
    return f"{effect['name']} at {effect['target']}"


def _effects(effects: Sequence[Values]) -> Table:
    what = "Wrong" if any(effect.get("too_much") for effect in effects) else "Missing"
    table = Table(title=f"{what} in the simulator", caption="parameters with their 95 % intervals")
    table.add_column("effect", overflow="fold")
    for heading in ("share", "probability"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("parameters")
    for effect in effects:
        known = (effect.get("parameters") or {}).items()
        parameters = "\n".join(_parameter(name, values) for name, values in known)
        shares = (percent(effect.get(key)) for key in ("share", "probability"))
        excess = "\ntoo much in the simulator" if effect.get("too_much") else ""
        table.add_row(f"{effect['name']}\n{effect['target']}{excess}", *shares, parameters)
    return table


def _parameter(name: str, found: Values) -> str:
    text, ends = estimate(found["value"], found.get("ci95"))
    words = [name, text, unit_text(found.get("unit")), "" if ends == MISSING else f"({ends})"]
    return " ".join(word for word in words if word)


def _errors(held_out: Values, *, corrected: bool) -> Table:
    learned = any(is_number((held_out.get(key) or {}).get("gp")) for key in FORECASTS)
    columns = {
        "before": "before" if corrected else "simulator",
        **({"after": "after"} if corrected else {}),
        **({"gp": "with learned.pt"} if learned else {}),
        "noise": "noise",
    }
    table = Table()
    table.add_column("forecast", no_wrap=True)
    for heading in columns.values():
        table.add_column(heading, justify="right", no_wrap=True)
    for key, title in FORECASTS.items():
        errors = held_out.get(key) or {}
        table.add_row(title, *(number(errors.get(column)) for column in columns))
    return table
