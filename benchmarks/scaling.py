"""Time and memory of refactor, append and predict as the data grows to 5000 points, as a table and a plot.

Each size runs in a process of its own. Memory is what the kernel counts as resident: the peak of an operation over
what was there before it (``VmHWM``, reset before each; needs Linux), and what the posterior keeps.
"""

from __future__ import annotations

import csv
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import torch
from harness import arguments, number, race, table, write
from task import pendulum_gp, uniform_transitions

from torch_activegp.models import DynamicsGP, FixedNoise
from torch_activegp.models.inverse_factor import InverseFactor
from torch_activegp.models.kernel_functions import KernelFunction

SIZES, QUICK_SIZES = (100, 200, 300, 500, 1000, 2000, 3000, 5000), (100, 300)
QUERIES = 50
COLUMNS = {
    "n": "n",
    "refactor_s": "refactor, ms",
    "append_s": "append, ms",
    "mean_s": f"mean of {QUERIES}, ms",
    "mean_and_variance_s": f"mean and variance of {QUERIES}, ms",
    "kept_bytes": "kept, MB",
    "refactor_bytes": "refactor, peak MB more",
    "append_bytes": "append, peak MB more",
    "predict_bytes": "predict, peak MB more",
}


def resident(field: str) -> int:
    """Memory of this process in bytes, ``VmRSS`` now or ``VmHWM`` at most."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field):
            return int(line.split()[1]) * 1024
    raise SystemExit(f"/proc/self/status has no {field}; this benchmark needs Linux.")


def peak_over(run: Callable[[], object]) -> int:
    """Largest resident memory while ``run`` runs over that before, in bytes."""
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak of this process
    before = resident("VmRSS")
    run()
    return max(0, resident("VmHWM") - before)


def kept(gp: DynamicsGP) -> int:
    """Bytes of the tensors that the posterior holds, the reserve for further points included."""
    held: dict[int, int] = {}
    owners = [
        gp.posterior,
        *(part for part in vars(gp.posterior).values() if isinstance(part, (InverseFactor, KernelFunction))),
    ]
    for value in (value for owner in owners for value in vars(owner).values()):
        if isinstance(value, torch.Tensor):
            storage = value.untyped_storage()
            held[storage.data_ptr()] = storage.nbytes()
    return sum(held.values())


def measure(n: int) -> dict[str, float]:
    """All figures at ``n`` points."""
    generator = torch.Generator().manual_seed(0)
    gp = pendulum_gp(FixedNoise(1.0 / n**2))
    gp.update(*uniform_transitions(n - 1, generator))
    repeats = max(3, min(100, 300_000 // n))
    z = torch.cat(uniform_transitions(QUERIES, generator)[:2], dim=-1)
    news = iter([uniform_transitions(1, generator) for _ in range(repeats + 5)])

    lengthscales = itertools.cycle((1.0, 1.001))  # another one each time, so that nothing is reused

    def refactor() -> None:
        gp.covar_module.lengthscale = next(lengthscales)
        _ = gp.posterior

    def mean() -> None:
        posterior = gp.posterior
        posterior.loc(posterior.features(z))

    def mean_and_variance() -> None:
        posterior = gp.posterior
        features = posterior.features(z)
        posterior.loc(features), posterior.variance(features)

    runs = {"refactor": refactor, "append": lambda: gp.update(*next(news)), "predict": mean_and_variance}
    memory = {name: peak_over(run) for name, run in runs.items()}
    times = race({"refactor": refactor}, max(3, min(25, 30_000 // n)), warm_up=1)
    times |= race({"append": runs["append"], "mean": mean, "mean_and_variance": mean_and_variance}, repeats, warm_up=1)
    return {
        "n": n,
        **{f"{name}_s": value for name, value in times.items()},
        "kept_bytes": kept(gp),
        **{f"{name}_bytes": value for name, value in memory.items()},
    }


def in_own_process(n: int, threads: int) -> dict[str, float]:
    """:func:`measure` in a fresh process."""
    command = [sys.executable, __file__, "--threads", str(threads)]
    done = subprocess.run(
        command, env={**os.environ, "SCALING_POINTS": str(n)}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"The run at {n} points failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def plot(results: list[dict[str, float]], path: Path) -> None:
    """Time and memory against the number of points, both axes logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    n = [result["n"] for result in results]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for key in ("refactor_s", "append_s", "mean_s", "mean_and_variance_s"):
        left.loglog(n, [1e3 * result[key] for result in results], "o-", label=COLUMNS[key].split(", ")[0])
    for key in ("kept_bytes", "refactor_bytes", "append_bytes", "predict_bytes"):
        values = [result[key] / 1e6 or float("nan") for result in results]
        right.loglog(n, values, "o-", label=COLUMNS[key].replace(" MB more", "").replace(", MB", ""))
    left.set(xlabel="points", ylabel="ms", title="time")
    right.set(xlabel="points", ylabel="MB", title="memory")
    for axes in (left, right):
        axes.legend(frameon=False)
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def scaled(key: str, value: float) -> float:
    """Seconds in ms, bytes in MB."""
    return value * 1e3 if key.endswith("_s") else value / 1e6 if key.endswith("_bytes") else value


def main() -> None:
    """Measure each size, print, write the table and the plot."""
    options = arguments(__doc__.splitlines()[0])
    if points := os.environ.get("SCALING_POINTS"):
        print(json.dumps(measure(int(points))))
        return
    results = [in_own_process(n, options.threads) for n in (QUICK_SIZES if options.quick else SIZES)]
    rows = [[number(scaled(key, result[key])) for key in COLUMNS] for result in results]
    write("scaling", options, {"results": results}, {"scaling": table(list(COLUMNS.values()), rows)})
    folder = options.out or (None if options.quick else Path(__file__).parent / "results")
    if folder is not None:
        with (folder / "scaling.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(COLUMNS))
            writer.writeheader()
            writer.writerows(results)
        plot(results, folder / "scaling.png")


if __name__ == "__main__":
    main()
