"""Independent work in processes of joblib, here or on Ray, whose results come as they are ready."""

from __future__ import annotations

import contextlib
import logging
import os
import warnings
from collections.abc import Callable, Generator, Mapping
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args

import cloudpickle
from joblib import Parallel, cpu_count, delayed, parallel_config
from joblib.externals.loky import get_reusable_executor

from torch_activegp.errors import ActiveGPError, ConfigurationError
from torch_activegp.experiments.workers import Tell, heard_by, interrupts_ignored, one_thread

Backend = Literal["loky", "ray"]
"""Processes of this computer, or of the Ray cluster that it belongs to."""
Work = Callable[[str, Any, Tell], Any]
"""From a name and its item to a result; tells messages as it goes."""


def spread(
    work: Work, items: Mapping[str, Any], jobs: int = 0, backend: Backend = "loky", tell: Tell = lambda _: None
) -> Generator[tuple[str, Any], None, None]:
    """Do the same work on many items, several at once.

    Every worker computes on one thread, in the working folder of this process where its computer has one. What it needs
    and what it finds travel as bytes, so neither side gets arrays that it cannot write to. The workers end with the
    iterator: after the last result, at an error, at Ctrl-C, or when it is closed.

    Args:
        work: what to do; like items and results, cloudpickle can pickle it if there is more than one worker.
        items: by name.
        jobs: how many at once; 0: one for each core, on Ray one for each CPU of the cluster. With one, everything
            happens in this process.
        backend: ``loky`` or ``ray``. Ray is started here, and ended, unless it runs already or ``RAY_ADDRESS`` names a
            cluster.
        tell: called with each message of the work as it comes, perhaps in another thread. Not from Ray.

    Returns:
        Name and result of each item, in the order in which they are ready.

    Raises:
        ConfigurationError: at once for arguments out of range or Ray that is not installed; later for Ray that cannot
            be reached.
        ActiveGPError: later, if a worker was killed.
    """
    if jobs < 0:
        raise ConfigurationError(f"jobs: 0 for each core, or a positive number wanted, found {jobs}.")
    if backend not in get_args(Backend):
        raise ConfigurationError(f"backend: one of {', '.join(get_args(Backend))} wanted, found {backend!r}.")
    if backend == "ray":
        return _on_ray(_load_ray(), work, items, jobs, tell)
    count = min(jobs or cpu_count(), len(items))
    return _in_processes(work, items, count, tell) if count > 1 else _here(work, items, tell)


def _here(work: Work, items: Mapping[str, Any], tell: Tell) -> Generator[tuple[str, Any], None, None]:
    for name, item in items.items():
        with one_thread():
            result = work(name, item, tell)
        yield name, result


def _in_processes(
    work: Work, items: Mapping[str, Any], count: int, tell: Tell
) -> Generator[tuple[str, Any], None, None]:
    try:
        with heard_by(tell) as tell_parent:
            with parallel_config("loky", n_jobs=count, inner_max_num_threads=1):
                pool = Parallel(return_as="generator_unordered", batch_size=1)
            yield from _results(pool, work, items, tell_parent)
    except BrokenProcessPool as error:
        raise _killed() from error
    finally:
        get_reusable_executor(reuse=True).shutdown(kill_workers=True)


def _on_ray(
    ray: Any, work: Work, items: Mapping[str, Any], jobs: int, tell: Tell
) -> Generator[tuple[str, Any], None, None]:
    ours = not ray.is_initialized()
    if ours:
        _start(ray)
    try:
        cpus = int(ray.cluster_resources().get("CPU", 1))
        count = min(jobs or cpus, cpus, len(items))
        if count > 1:
            pool = Parallel(count, backend=_ray_backend(), return_as="generator_unordered", batch_size=1)
            yield from _results(pool, work, items, _silent)
        else:
            yield from _here(work, items, tell)
    except ray.exceptions.RayActorError as error:
        raise _killed() from error
    finally:
        if ours:
            ray.shutdown()


def _load_ray() -> Any:
    try:
        return import_module("ray")
    except ImportError as error:
        raise ConfigurationError(
            "backend ray: Ray is not installed. Install it: pip install 'torch-activegp[ray]'; or use backend loky."
        ) from error


def _start(ray: Any) -> None:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing leaves the laboratory unless it is wanted
    try:
        ray.init(log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise ConfigurationError(
            f"backend ray: no cluster can be reached or started: {error}. Check RAY_ADDRESS, or use backend loky."
        ) from error


def _ray_backend() -> Any:
    base: Any = import_module("ray.util.joblib.ray_backend").RayBackend
    # What keeps joblib's multiprocessing, from which Ray's backend inherits, from giving results one by one is that
    # pool's way to end; Ray's pool has its own.
    return type("StreamingRayBackend", (base,), {"supports_return_generator": True})()


def _results(
    pool: Parallel, work: Work, items: Mapping[str, Any], tell: Tell
) -> Generator[tuple[str, Any], None, None]:
    folder = os.getcwd()
    calls = [delayed(_do)(_packed(name, (work, name, item, tell, folder))) for name, item in items.items()]
    with interrupts_ignored():
        results = pool(calls)
    try:
        for result in results:
            yield cloudpickle.loads(result)
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # joblib counts what an early end leaves undone
            results.close()


def _packed(name: str, value: Any) -> bytes:
    try:
        return bytes(cloudpickle.dumps(value))
    except Exception as error:
        raise ConfigurationError(
            f"{name}: cannot be sent to another process ({error}). Give files in place of objects, or use one job."
        ) from error


def _do(packed: bytes) -> bytes:
    work, name, item, tell, folder = cloudpickle.loads(packed)
    with contextlib.chdir(folder) if Path(folder).is_dir() else contextlib.nullcontext(), one_thread():
        return _packed(name, (name, work(name, item, tell)))


def _silent(message: Any) -> None:
    """What a worker on another computer says is not heard."""


def _killed() -> ActiveGPError:
    return ActiveGPError("A worker process was killed, as happens when memory runs out. Use fewer jobs.")
