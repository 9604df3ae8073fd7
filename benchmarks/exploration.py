"""How many samples each method needs: a table from the runs of ``torch-activegp figures``.

    torch-activegp figures pendulum-brake --methods discrepancy,opax-prior,sigma,directed --seed 100 --out runs/brake
    python benchmarks/exploration.py runs/brake

For every method: the median over the trials of the error after some episodes, and the first episode after which this
median is at most the *final* median of each baseline.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pandas as pd

BASELINES = ("opax-prior", "sigma")
EPISODES = (1, 5, 10, 15, 20, 30)


def median_error(table: pd.DataFrame) -> pd.DataFrame:
    """One row an episode, one column a method: the median error over the trials, times 1000."""
    median = table.groupby(["episode", "method"])["mse"].median().unstack("method") * 1e3
    return median[list(table["method"].unique())]


def first_below(curve: pd.Series, target: float) -> str:
    """The first episode from which on the curve is at most the target."""
    above = curve[curve > target]
    if above.empty:
        return str(curve.index[0])
    after = curve.index[curve.index > above.index[-1]]
    return str(after[0]) if len(after) else "-"


def markdown(folder: Path) -> str:
    """The table of one run."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    table = pd.read_csv(folder / "metrics.csv")
    median = median_error(table)
    spread = table[table["episode"] == table["episode"].max()].groupby("method")["mse"].agg(["min", "max"]) * 1e3
    last = median.index[-1]
    shown = [episode for episode in EPISODES if episode <= last]
    baselines = [name for name in BASELINES if name in median]
    head = ["method", *(f"{n}" for n in shown), "range at the end", *(f"reaches {name}'s end" for name in baselines)]
    lines = [
        f"**{summary['system']}** (simulator alone: {1e3 * summary['prior_mse']:.3g}; {summary['trials']} trials, "
        f"seeds from {summary['seed']})",
        "",
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
    ]
    for method in median:
        curve = median[method]
        cells = [method, *(f"{curve[n]:.3g}" for n in shown)]
        cells.append(f"{spread.loc[method, 'min']:.3g} to {spread.loc[method, 'max']:.3g}")
        cells += [first_below(curve, median[name][last]) for name in baselines]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print the tables of the runs named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, nargs="+", help="output folder of `torch-activegp figures`")
    print("\n\n".join(markdown(folder) for folder in parser.parse_args().run))


if __name__ == "__main__":
    main()
