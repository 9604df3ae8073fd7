"""What all benchmarks share: arguments, interleaved timing, the machine's description, tables and results."""

from __future__ import annotations

import argparse
import json
import platform
import re
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

HERE = Path(__file__).resolve().parent


def arguments(description: str) -> argparse.Namespace:
    """Read the command line, set the number of threads and seed torch."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--quick", action="store_true", help="small sizes, few repetitions, nothing written by default")
    parser.add_argument("--threads", type=int, default=0, help="threads of torch (default: 1 if --quick, else 2)")
    parser.add_argument("--out", type=Path, help="folder of the results (default: none if --quick, else results/)")
    options = parser.parse_args()
    options.threads = options.threads or (1 if options.quick else 2)
    torch.set_num_threads(options.threads)
    torch.manual_seed(0)  # CEMPlanner has no generator of its own
    return options


def race(runners: Mapping[str, Callable[[], object]], repeats: int, warm_up: int = 2) -> dict[str, float]:
    """Time runners in turns, so that a busy machine slows all alike; the median of each, in seconds."""
    times: dict[str, list[float]] = {name: [] for name in runners}
    for round_number in range(-warm_up, repeats):
        for name, run in runners.items():
            start = time.perf_counter()
            run()
            elapsed = time.perf_counter() - start
            if round_number >= 0:
                times[name].append(elapsed)
    return {name: statistics.median(values) for name, values in times.items()}


def race_prepared(
    runners: Mapping[str, tuple[Callable[[], Any], Callable[[Any], object]]], repeats: int
) -> dict[str, float]:
    """Like :func:`race`, where each run starts from something made outside of the clock."""
    times: dict[str, list[float]] = {name: [] for name in runners}
    for round_number in range(-1, repeats):
        for name, (prepare, run) in runners.items():
            state = prepare()
            start = time.perf_counter()
            run(state)
            elapsed = time.perf_counter() - start
            if round_number >= 0:
                times[name].append(elapsed)
    return {name: statistics.median(values) for name, values in times.items()}


def machine(options: argparse.Namespace) -> dict[str, object]:
    """Say on what the figures were taken."""
    info = Path("/proc/cpuinfo")
    models = re.findall(r"model name\s*: (.+)", info.read_text()) if info.exists() else []
    packages = ("torch", "torchrl", "tensordict", "gpytorch")
    return {
        "cpu": models[0] if models else platform.processor(),
        "cores": len(models),
        "threads": options.threads,
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def number(value: object) -> str:
    """Three significant digits for floats, anything else as it is."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table, which reads well in a terminal too."""
    cells = [list(header), *([number(cell) for cell in row] for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(header))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in cells
    ]
    return "\n".join([lines[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines[1:]])


def write(name: str, options: argparse.Namespace, results: Mapping[str, object], tables: Mapping[str, str]) -> None:
    """Print the tables; write ``name.json``, and put the tables of a full run between their marks in the README."""
    conditions = machine(options)
    for title, text in tables.items():
        print(f"\n{title}\n\n{text}")
    print("\n" + ", ".join(f"{key} {value}" for key, value in conditions.items()))
    folder = options.out or (None if options.quick else HERE / "results")
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    content = {"machine": conditions, "quick": options.quick, **results}
    (folder / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    if folder == HERE / "results" and not options.quick:
        _put_into_readme(tables, conditions)


def _put_into_readme(tables: Mapping[str, str], conditions: Mapping[str, object]) -> None:
    readme = HERE / "README.md"
    text = readme.read_text(encoding="utf-8")
    source = f"{conditions['cpu']}, {conditions['threads']} threads, torch {conditions['torch']}."
    for title, content in tables.items():
        begin, end = f"<!-- {title} -->\n", f"<!-- end of {title} -->"
        before, rest = text.split(begin)
        text = before + begin + f"{content}\n\n{source}\n" + end + rest.split(end)[1]
    readme.write_text(text, encoding="utf-8")
