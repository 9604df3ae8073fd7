"""``python -m benchmarks.real``: diagnose the recordings of real hardware, and compare with what is known of them."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.real import balls, emps, laas, multiarm
from torch_activegp.data.balls import BALLS

Row = tuple[str, str, bool]
SETS = ("emps", "multiarm", "laas", "balls")


def diagnose(folder: Path, model: str, recordings: Sequence[str], holdout: Sequence[str] = ()) -> dict[str, Any]:
    """Run the command line, unless its answer is there already, and read the answer."""
    answer = folder / "diagnosis.json"
    if not answer.is_file():
        command = [sys.executable, "-c", "from torch_activegp.cli import main; main()", "diagnose", model, *recordings]
        command += [word for name in holdout for word in ("--holdout", name)]
        done = subprocess.run(
            [*command, "--out", str(folder)],
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise SystemExit(f"diagnose {model} {' '.join(recordings)} ended with {done.returncode}:\n{done.stderr}")
    result: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
    return result


def _emps(out: Path) -> list[Row]:
    return emps.judge(diagnose(out / "emps", "emps", ["emps:train"], ["emps:test"]))


def _multiarm(out: Path) -> list[Row]:
    folder = out / "multiarm"
    return multiarm.judge(diagnose(folder, "multiarm", ["multiarm:train"], ["multiarm:test"]), folder)


def _laas(out: Path) -> list[Row]:
    fast = diagnose(out / "laas_acc_current", "laas", ["laas:acc_current"])
    slow = diagnose(out / "laas_speed_test", "laas", ["laas:speed_test1"], ["laas:speed_test"])
    return [*laas.judge_friction(fast), *laas.judge_cogging(slow)]


def _balls(out: Path) -> list[Row]:
    return balls.judge(
        {ball: diagnose(out / ball, "balls", [f"balls:{ball}_1"], [f"balls:{ball}_2"]) for ball in BALLS}
    )


_JUDGES: dict[str, Callable[[Path], list[Row]]] = {"emps": _emps, "multiarm": _multiarm, "laas": _laas, "balls": _balls}
_REFERENCES = {
    "emps": emps.reference,
    "multiarm": multiarm.reference,
    "laas": laas.reference,
    "balls": balls.reference,
}


def main() -> None:
    """Print one markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sets", nargs="*", metavar="SET", help=f"of {', '.join(SETS)} (default: all)")
    parser.add_argument("--out", type=Path, default=Path("runs/real"), help="folder of the diagnoses, kept and reused")
    parser.add_argument("--reference", action="store_true", help="plain least squares instead of a diagnosis")
    options = parser.parse_args()
    chosen = options.sets or SETS
    if unknown := set(chosen) - set(SETS):
        parser.error(f"no data set {', '.join(sorted(unknown))}: {', '.join(SETS)} wanted")
    if options.reference:
        print("\n\n".join("\n".join(_REFERENCES[name]()) for name in chosen))
        return
    print("| data set | bar | found | |\n|---|---|---|---|")
    for name in chosen:
        for bar, found, held in _JUDGES[name](options.out):
            print(f"| {name} | {bar} | {found} | {'held' if held else '**missed**'} |", flush=True)


if __name__ == "__main__":
    main()
