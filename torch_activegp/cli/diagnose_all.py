"""``torch-activegp diagnose-all``: what is missing in the simulators of many machines."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from torch_activegp.cli.app import FAILED, INTERRUPTED, app, console, results
from torch_activegp.cli.folders import check_free, results_in
from torch_activegp.cli.options import Columns, Seed, place
from torch_activegp.cli.progress import EpisodeProgress, show_time
from torch_activegp.data import ColumnMap
from torch_activegp.errors import ActiveGPError, ConfigurationError, DataError
from torch_activegp.experiments.fleet import Job, diagnose_all
from torch_activegp.experiments.output import write_json
from torch_activegp.experiments.spread import Backend
from torch_activegp.report import write_report

if TYPE_CHECKING:
    from torch_activegp.diagnosis import Diagnosis

_DONE = "diagnosis.json"
_FAILED = "failed"

Settings = Mapping[str, Any]


@app.command("diagnose-all")
def diagnose_many(
    folders: Annotated[
        list[Path],
        typer.Argument(
            help="One machine each: one MJCF file *.xml, and recordings of any kind that `diagnose` reads; those whose "
            "names begin with test or holdout are held out. The folder's name is the machine's.",
            metavar="FOLDER",
        ),
    ],
    out: Annotated[
        Path, typer.Option(parser=place, help="Output folder; holds one folder for each machine.", metavar="DIR")
    ],
    columns: Columns = None,
    seed: Seed = 0,
    jobs: Annotated[
        int, typer.Option(min=0, help="Machines at once, each on one thread; 0: one for each core (or Ray's CPU).")
    ] = 0,
    backend: Annotated[
        Backend, typer.Option(help="Processes of this computer, or Ray (RAY_ADDRESS names the cluster).")
    ] = "loky",
) -> None:
    """Diagnose many machines, several at once, each as `torch-activegp diagnose` does.

    Example:  `torch-activegp diagnose-all machines/* --out results`

    DIR/MACHINE holds what `diagnose` writes, as soon as that machine is done, whole or not at all. Machines that are
    there already are skipped, so the same command goes on with a run that was interrupted. A machine that fails, for
    example for a bad recording, is reported and stops no other; the exit code is then 1.
    """
    began = time.perf_counter()
    check_free(out, ())
    names = _names(folders, out)
    verdicts = {name: _kept(out / name) for name in names if _is_done(out / name)}
    chosen = None if columns is None else ColumnMap.from_toml(columns)
    machines, settings = {}, {}
    skipped = len(verdicts)
    for name, folder in names.items():
        try:
            job = Job.from_folder(folder, chosen)
        except DataError as error:
            verdicts.setdefault(name, _failure(name, error))
            continue
        settings[name] = _settings(job, columns, seed)
        if name in verdicts:
            _compare(out / name, settings[name])
        else:
            machines[name] = job
    if skipped:
        _say(f"Skipped, because {out} holds them: {skipped} of {len(names)} machines.")
    with _going_on(out), EpisodeProgress(console, "diagnosing", len(machines), unit="machines") as progress:
        tell = _stages(progress.tell)
        with closing(diagnose_all(machines, jobs=jobs, backend=backend, seed=seed, tell=tell)) as found:
            for name, result in found:
                verdicts[name] = _keep(name, result, out, settings[name])
                progress.advance()
    results.print(_table({name: verdicts[name] for name in names}))
    failed = sum(verdict == _FAILED for verdict, _ in verdicts.values())
    done = len(names) - skipped - failed
    counts = f"{done} machine{'' if done == 1 else 's'} diagnosed, {skipped} skipped, {failed} failed"
    _say(f"Done in {show_time(time.perf_counter() - began)}: {counts}. See {out}.", results)
    if failed:
        raise typer.Exit(FAILED)


def _names(folders: list[Path], out: Path) -> dict[str, Path]:
    """Folders by the names of their machines, without the output folder, which a pattern may catch."""
    names: dict[str, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise ConfigurationError(f"{folder}: a folder with one machine wanted; there is none.")
        if folder.resolve() == out.resolve():
            continue
        name = folder.resolve().name
        if name in names:
            raise ConfigurationError(
                f"{names[name]} and {folder} are both named {name}, so their results would be too. Rename one."
            )
        names[name] = folder
    if not names:
        raise ConfigurationError(f"No machine: {out} is the output folder. Name folders with one machine each.")
    return names


def _is_done(folder: Path) -> bool:
    """Whether a machine's results are there.

    Raises:
        ConfigurationError: something else is there.
    """
    if (folder / _DONE).is_file():
        return True
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise ConfigurationError(f"{folder} is there and holds no {_DONE}. Move it, or choose another --out.")
    return False


def _kept(folder: Path) -> tuple[str, str]:
    try:
        found = json.loads((folder / _DONE).read_text(encoding="utf-8"))
        return str(found["verdict"]), str(found["sentence"])
    except (KeyError, OSError, TypeError, ValueError) as error:
        raise ConfigurationError(
            f"{folder / _DONE} is damaged ({error!r}). Remove {folder} to diagnose the machine again."
        ) from error


def _settings(job: Job, columns: Path | None, seed: int) -> Settings:
    return {
        "command": "diagnose",
        "model": str(job.model),
        "recordings": [str(path) for path in job.recordings],
        "holdout": [str(path) for path in job.holdout],
        "columns": None if columns is None else str(columns),
        "seed": seed,
    }


def _compare(folder: Path, settings: Settings) -> None:
    """Say where the results that are there were made from something else."""
    try:
        found = json.loads((folder / "settings.json").read_text(encoding="utf-8"))
        changed = [key for key, value in settings.items() if key != "command" and _plain(found[key]) != _plain(value)]
    except (KeyError, OSError, TypeError, ValueError):
        return
    if changed:
        _say(
            f"{folder.name}: skipped, though its results are of another {', another '.join(changed)}. Remove {folder} "
            "to diagnose it again."
        )


def _plain(value: Any) -> Any:
    """The value without the folders of files, from wherever the command was called."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return Path(value).name if isinstance(value, str) else value


def _keep(name: str, result: Diagnosis | ActiveGPError, out: Path, settings: Settings) -> tuple[str, str]:
    """Write what was found on a machine, all of it or nothing."""
    if isinstance(result, ActiveGPError):
        return _failure(name, result)
    found = result.to_dict()
    folder = out / f".{name}.part"
    with results_in(out):
        if folder.exists():  # of a run that was killed
            shutil.rmtree(folder)
        folder.mkdir()
        try:
            result.save(folder)
            write_report(found, result.evidence, folder / "report.html")
            write_json(folder / "settings.json", settings)
            if (out / name).is_dir():  # empty, as was seen before
                (out / name).rmdir()
            folder.rename(out / name)
        except DataError as error:
            return _failure(name, error)
        finally:
            if folder.exists():
                shutil.rmtree(folder)
    return result.verdict, result.sentence


def _failure(name: str, error: ActiveGPError) -> tuple[str, str]:
    _say(f"{name}: {error}")
    return _FAILED, str(error)


def _stages(show: Callable[[str], None]) -> Callable[[str, str, float | None], None]:
    """Shows the machine that spoke last; the others wait for their turn."""

    def hear(name: str, stage: str, done: float | None) -> None:
        show(f"{name}: {stage}" + ("" if done is None else f", {done:.0%}"))

    return hear


@contextmanager
def _going_on(out: Path) -> Iterator[None]:
    """Say after Ctrl-C how the run goes on."""
    try:
        yield
    except KeyboardInterrupt as error:
        _say(f"Interrupted. {out} keeps every machine that was done: the same command goes on with the others.")
        raise typer.Exit(INTERRUPTED) from error


def _table(verdicts: Mapping[str, tuple[str, str]]) -> Table:
    table = Table(title="Machines")
    table.add_column("machine", overflow="fold")
    table.add_column("verdict", no_wrap=True)
    table.add_column("in words", overflow="fold")
    for name, (verdict, words) in verdicts.items():
        table.add_row(Text(name), Text(verdict, style="red" if verdict == _FAILED else ""), Text(words))
    return table


def _say(text: str, to: Any = console) -> None:
    to.print(text, highlight=False, markup=False, soft_wrap=True)
