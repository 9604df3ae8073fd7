"""What a diagnosis got right: with the oracle, the only code that opens the keys."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.concealed.equivalence import Entry, decomposed, equals, partners
from benchmarks.concealed.places import normal, places
from benchmarks.concealed.regions import score_regions
from benchmarks.concealed.run import digest
from benchmarks.concealed.values import noise_of, score_values

VISIBLE = 1.05
"""Times the noise from which on a held-out error shows that something is missing."""
TUNED = ("viscous_friction", "armature_error", "actuator_gain", "actuator_bias", "constant_force")
"""What may be named beside the truth when the nominal was re-tuned: the tuning itself is wrong there."""

FAILED: dict[str, Any] = {"verdict": "failed", "mismatch": {"detected": False}}

CLEAR = 10.0
"""A tie is none where the truth fits the recordings better by so much in chi2: odds of 150 to 1."""

RARE = 0.05
"""An effect that acts in fewer of the rows is concealed by that."""


def options(effect: Mapping[str, Any]) -> list[Entry]:
    """The entry itself, then its ties."""
    ties = effect.get("ties") or []
    return [normal(entry["name"], entry["target"]) for entry in (effect, *ties)]


def score_case(
    key: Mapping[str, Any],
    diagnosis: Mapping[str, Any],
    cases: Path | None = None,
    oracle: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """One row of results.

    Args:
        key: the truth.
        diagnosis: by the contract.
        cases: folder of the cases, for the regions; left out without it.
        oracle: what the oracle says of the case, to compare forecasts with and to check ties.
    """
    truths = [normal(effect["name"], effect["target"]) for effect in key["effects"]]
    said = [options(effect) for effect in diagnosis.get("effects") or []]
    row: dict[str, Any] = {part: key[part] for part in ("case", "kind", "system", "loop", "rate", "chi2_per_dof")}
    row |= {"verdict": diagnosis["verdict"], "concealments": key["concealments"], "truths": truths, "said": said}
    row |= {"noise": noise_of(key), "detected": bool(diagnosis["mismatch"]["detected"])}
    row["ties"] = [len(entries) for entries in said if len(entries) > 1]
    row |= _names(key, truths, said, diagnosis["verdict"], genuine(oracle))
    row["tie_unchecked"] = row["tie_claimed"] and "tie" not in (oracle or {})
    row["places"] = places(key, diagnosis)
    row["parameters"] = score_values(key, diagnosis)
    claims = zip(diagnosis.get("effects") or [], row["right"], strict=True)
    row["probability"] = [(float(e["probability"]), good) for e, good in claims if e.get("probability") is not None]
    row |= _forecasts(diagnosis, oracle)
    areas, shares = score_regions(key, diagnosis, cases) if cases else ([], [])
    row["auc"] = areas
    if any(share < RARE for share in shares):
        row["concealments"] = [*row["concealments"], "rare"]
    return row


def genuine(oracle: Mapping[str, Any] | None) -> bool:
    """Whether what was named first fits the recordings as well as the truth does, given the oracle's parameters."""
    if oracle is None or "tie" not in oracle:
        return False
    said = oracle["tie"]
    return bool(said["chi2"] - oracle["chi2"] < CLEAR + max(oracle["parameters"] - said["parameters"], 0))


def _names(
    key: Mapping[str, Any], truths: list[Entry], said: list[list[Entry]], verdict: str, checked: bool
) -> dict[str, Any]:
    """Which truths are found, first or among ties, and which names are wrong; outside of the list, any name is."""
    listed = key["kind"] != "outside"
    same = [equals(truth, key) for truth in truths] if listed else []
    allowed = partners(key["effects"], key) if listed else set()
    firsts = {entries[0] for entries in said}
    anywhere = {entry for entries in said for entry in entries}
    first, found = [], []
    for effect, group in zip(key["effects"], same, strict=False):
        parts = decomposed(effect, key)
        split = parts is not None and all(part & firsts for part in parts)
        first.append(bool(group & firsts) or split)
        found.append(bool(group & anywhere) or split)
    fine = set().union(*same, allowed)
    right = [bool(fine & set(entries)) for entries in said]
    excused = [key.get("retuned", False) and entries[0][0] in TUNED for entries in said]
    wrong = [entries[0] for entries, good, tuned in zip(said, right, excused, strict=True) if not good and not tuned]
    claims = verdict in ("named", "tie")
    complete = listed and bool(truths) and claims and not wrong
    exact, claimed = complete and all(first), complete and all(found)
    return {
        "right": [entries[0] in fine or tuned for entries, tuned in zip(said, excused, strict=True)],
        "first": [claims and hit for hit in first],
        "wrong": wrong,
        "exact": exact,
        "tied": exact or (claimed and checked),
        "tie_claimed": claimed and not exact,
        "any_wrong": claims and bool(wrong),
        "false_alarm": not truths and (verdict != "none" or bool(said)),
        "abstained": verdict in ("none", "unknown"),
    }


def _forecasts(diagnosis: Mapping[str, Any], oracle: Mapping[str, Any] | None) -> dict[str, float]:
    """Held-out errors: after over noise and over the oracle's, and with the Gaussian process over before."""
    holdout = (diagnosis.get("fit") or {}).get("holdout") or {}
    best = (oracle or {}).get("holdout") or {}
    found: dict[str, float] = {}
    for measure in ("one_step", "free_run"):
        values = holdout.get(measure) or {}
        after = values.get("after")
        found[measure] = _ratio(after, values.get("noise"))
        found[f"{measure}_oracle"] = _ratio(after, (best.get(measure) or {}).get("oracle"))
        found[f"{measure}_learned"] = _ratio(values.get("gp", after), values.get("before"))
        found[f"{measure}_learned_beyond_noise"] = _beyond_noise(values.get("gp", after), values)
    return found


def _beyond_noise(error: float | None, values: Mapping[str, float]) -> float:
    """What an error is beyond noise over what the nominal's is; NaN where the nominal errs by little but noise."""
    before, noise = values.get("before"), values.get("noise")
    if error is None or before is None or noise is None or before < VISIBLE * noise:
        return float("nan")
    return float(np.sqrt(max(error**2 - noise**2, 0.0) / (before**2 - noise**2)))


def _ratio(value: float | None, reference: float | None) -> float:
    return float(value / reference) if value is not None and reference else float("nan")


def score_all(out: Path, way: str = "diagnosis") -> tuple[list[dict[str, Any]], list[str]]:
    """Score every case that was run, and list those that were not; one that failed counts as a wrong answer."""
    rows, missing = [], []
    for path in sorted((out / "keys").glob("*.json")):
        folder = out / "results" / way / path.stem
        answer, failed = _read(folder / "diagnosis.json"), folder / "failed.txt"
        if answer is None and not failed.exists():
            missing.append(path.stem)
            continue
        oracle = _read(out / "results" / "oracle" / path.stem / "oracle.json")
        if oracle is not None and oracle.get("diagnosis") != digest(folder / "diagnosis.json"):
            oracle.pop("tie", None)  # of another diagnosis
        key = json.loads(path.read_text(encoding="utf-8"))
        row = score_case(key, FAILED if failed.exists() or answer is None else answer, out / "cases", oracle)
        usage = _read(folder / "usage.json") or {}
        row["late"] = failed.exists() and failed.read_text(encoding="utf-8").startswith("out of time")
        row |= {name: usage.get(name) or np.nan for name in ("seconds", "cpu_seconds", "peak_mib")}
        rows.append(row)
    return rows, missing


def _read(path: Path) -> dict[str, Any] | None:
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else None
