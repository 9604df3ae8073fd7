"""Command line: `python -m benchmarks.unseen make | score | check`."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from benchmarks.unseen.cases import build
from benchmarks.unseen.catalogue import SPECS, order
from benchmarks.unseen.check import check
from benchmarks.unseen.score import score
from benchmarks.unseen.write import readme, write


def make(out: Path, seed: int, only: list[str], fresh: bool) -> None:
    """All cases, or those named; cases that are there already stay."""
    out.mkdir(parents=True, exist_ok=True)
    readme(out, seed)
    for place, index in enumerate(order(seed), start=1):
        name, spec = f"case{place:02d}", SPECS[index]
        if (only and name not in only) or (not fresh and not only and (out / "keys" / f"{name}.json").exists()):
            continue
        began = time.perf_counter()
        try:
            case = build(spec, seed, index)
        except (ValueError, ArithmeticError) as error:
            print(f"{name} {spec.kind:8} {spec.machine:10} FAILED: {error}", flush=True)
            continue
        found = write(case, out, name)
        took = time.perf_counter() - began
        print(f"{name} {spec.kind:8} {spec.machine:10} {took:5.1f} s chi2 {case.chi2:10.3f} (untuned "
              f"{case.chi2_untuned:9.3f}) {case.alone} {found or ''}", flush=True)  # fmt: skip


def main() -> None:
    """Parse and run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.unseen", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="write the cases")
    scoring = commands.add_parser("score", help="compare diagnosis.json files with the keys")
    commands.add_parser("check", help="compare our accelerations with MuJoCo's")
    for sub in (making, scoring):
        sub.add_argument("--out", type=Path, required=True)
    making.add_argument("--seed", type=int, default=3)
    making.add_argument("--only", nargs="*", default=[], help="names of cases")
    making.add_argument("--fresh", action="store_true", help="make again what is there")
    scoring.add_argument("--results", type=Path, required=True)
    args = parser.parse_args()
    if args.command == "make":
        make(args.out, args.seed, args.only, args.fresh)
    elif args.command == "score":
        print(score(args.out, args.results))
    else:
        for name, worst in check().items():
            print(f"{name:10} {worst:.1e}")


if __name__ == "__main__":
    main()
