"""Which cases a folder holds, in an order of which every beginning is a fair sample."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from benchmarks.concealed.cases import COUNTS, Spec, list_cases


class OtherSetError(Exception):
    """The folder holds the cases of another seed or of other numbers."""


def stratified(specs: Sequence[Spec]) -> list[Spec]:
    """The kinds interleaved in proportion to their size; within a kind in turn, as effects and machines are drawn."""
    sizes = {kind: sum(spec.kind == kind for spec in specs) for kind in COUNTS}
    return sorted(specs, key=lambda spec: ((spec.index + 0.5) / sizes[spec.kind], list(COUNTS).index(spec.kind)))


def begin_set(out: Path, seed: int, counts: Mapping[str, int]) -> list[Spec]:
    """The cases to make, in order; leaves the order in the folder, by neutral names alone.

    Raises:
        OtherSetError: names in this folder stand for other cases.
    """
    specs = stratified(list_cases(seed, counts))
    content = {"seed": seed, "counts": dict(counts), "order": [spec.name for spec in specs]}
    path = out / "set.json"
    if path.exists() and json.loads(path.read_text(encoding="utf-8")) != content:
        raise OtherSetError(f"{path} is of another seed or of other numbers of cases; choose another --out.")
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return specs


def made_cases(out: Path) -> Iterator[Path]:
    """Folders of the cases that are made, in order; by name where no order was left."""
    path = out / "set.json"
    folders = sorted(folder for folder in (out / "cases").glob("[!.]*") if folder.is_dir())
    if path.exists():
        names = json.loads(path.read_text(encoding="utf-8"))["order"]
        folders = [out / "cases" / name for name in names if (out / "cases" / name).is_dir()]
    yield from folders
