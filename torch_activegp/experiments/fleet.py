"""The diagnosis of many machines, side by side."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Generator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch_activegp.data import ColumnMap, Recording
from torch_activegp.data.tables import SUFFIXES
from torch_activegp.errors import ActiveGPError, ConfigurationError, DataError
from torch_activegp.experiments.recorded import HELD_OUT, load_apart
from torch_activegp.experiments.spread import Backend, spread
from torch_activegp.experiments.workers import Tell

if TYPE_CHECKING:
    from torch_activegp.diagnosis import Diagnosis

Runs = Sequence[Recording | str | Path]
TellStage = Callable[[str, str, float | None], None]
"""Hears the machine, the name of its stage, and the part of its work that is done, 0 to 1 or None."""


@dataclasses.dataclass(frozen=True)
class Job:
    """One machine to diagnose.

    Args:
        model: whatever :func:`~torch_activegp.diagnosis.diagnose` takes.
        recordings: to fit: recordings, or words that :func:`~torch_activegp.experiments.recorded.load_named` takes;
            files are read by the worker, so that not all machines are in memory at once.
        holdout: the same, only to forecast; without any, a part is set aside.
        columns: a column map for the files, or its path.
    """

    model: Any
    recordings: Runs
    holdout: Runs = ()
    columns: ColumnMap | Path | None = None

    @classmethod
    def from_folder(cls, folder: str | Path, columns: ColumnMap | Path | None = None) -> Job:
        """The machine in a folder: one MJCF file ``*.xml``, and recordings of any kind that can be read.

        Recordings whose names begin with ``test`` or ``holdout`` are held out. Other files do not matter.

        Args:
            folder: of this machine alone; folders in it count only if they are TensorDict memmaps.
            columns: a column map for its recordings, or its path.

        Raises:
            DataError: not one model, or no recording to fit.
        """
        folder = Path(folder)
        try:
            paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        except OSError as error:
            raise DataError(f"{folder}: cannot be read as a folder: {error.strerror or error}.") from error
        models = [path for path in paths if path.suffix.lower() == ".xml" and path.is_file()]
        if len(models) != 1:
            found = ", ".join(path.name for path in models) or "none"
            raise DataError(
                f"{folder}: one MJCF file *.xml wanted, found {found}. Keep one machine in a folder, and files that "
                "its model includes in a folder below."
            )
        runs = [path for path in paths if path.suffix.lower() in SUFFIXES or (path / "meta.json").is_file()]
        held_out = [path for path in runs if path.name.lower().startswith(HELD_OUT)]
        fitted = [path for path in runs if path not in held_out]
        if not fitted:
            found = f", only held-out ones ({', '.join(path.name for path in held_out)})" if held_out else ""
            raise DataError(
                f"{folder}: no recording to fit{found}. Wanted files that end in {', '.join(SUFFIXES)} and begin with "
                f"another word than {' or '.join(HELD_OUT)}."
            )
        return cls(models[0], fitted, held_out, columns)

    def load(self) -> tuple[list[Recording], list[Recording]]:
        """Read the files.

        Returns:
            Recordings to fit, and those held out.

        Raises:
            DataError: there is no such file, a file is no recording, or something is both fitted and held out.
        """
        loaded = load_apart(_words(self.recordings), _words(self.holdout), self.columns)
        given = ([run for run in runs if isinstance(run, Recording)] for runs in (self.recordings, self.holdout))
        fit, test = ([*runs, *read] for runs, read in zip(given, loaded, strict=True))
        return fit, test


def diagnose_all(
    machines: Mapping[str, Job],
    *,
    jobs: int = 0,
    backend: Backend = "loky",
    seed: int = 0,
    tell: TellStage | None = None,
) -> Generator[tuple[str, Diagnosis | ActiveGPError], None, None]:
    """Diagnose many machines, several at once, each on one thread.

    What fails for one machine comes as its result and does not stop the others.

    Args:
        machines: by name.
        jobs: how many at once; 0: one for each core, on Ray one for each CPU of the cluster.
        backend: ``loky``, processes of this computer; or ``ray``, a cluster, whose computers see the same files.
        seed: of the controls proposed for the next experiment.
        tell: hears the stage of each machine, perhaps in another thread; not from Ray.

    Returns:
        Name and diagnosis of each machine, in the order in which they are ready; in place of a diagnosis the error: a
        :class:`~torch_activegp.errors.DataError` where recordings are at fault.

    Raises:
        ConfigurationError: at once for arguments out of range or Ray that is not installed; later for Ray that cannot
            be reached, and for a job that cannot be sent to another process.
        ActiveGPError: later, if a worker was killed.

    Example:
        >>> dict(diagnose_all({}))
        {}
    """
    if seed < 0:
        raise ConfigurationError(f"seed: 0 or a positive number wanted, found {seed}.")
    hear: Tell = (lambda _: None) if tell is None else (lambda message: tell(*message))
    return spread(partial(_attempt, seed=seed), machines, jobs, backend, hear)


def _attempt(name: str, job: Job, tell: Tell, seed: int) -> Diagnosis | ActiveGPError:
    from torch_activegp.diagnosis import diagnose

    try:
        fit, test = job.load()
        return diagnose(job.model, fit, test, seed=seed, nthread=1, tell=lambda stage, done: tell((name, stage, done)))
    except ActiveGPError as error:
        return error
    except Exception as error:  # one machine must not cost the night of all others
        return ActiveGPError(
            f"failed with {type(error).__name__}: {error}. This should not happen; diagnose it alone to see where."
        )


def _words(runs: Runs) -> list[str]:
    return [str(run) for run in runs if not isinstance(run, Recording)]
