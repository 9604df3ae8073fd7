"""What a diagnosis got right: the only code that opens the keys."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from benchmarks.concealed.equivalence import Entry, decomposed, equals, partners

TUNED = ("viscous_friction", "armature_error", "actuator_gain", "actuator_bias", "constant_force")
"""What may be named beside the truth when the nominal was re-tuned: the tuning itself is wrong there."""

FAILED: dict[str, Any] = {"verdict": "failed", "mismatch": {"detected": False}}


def normal(name: str, target: str) -> Entry:
    """A name and its target, where a sensor may go by its own name, its channel or its joint."""
    kind, _, rest = target.partition(":")
    if kind == "sensor":
        rest = rest.removeprefix("qpos.").removesuffix("_encoder")
    return name, f"{kind}:{rest}" if rest else kind


def options(effect: Mapping[str, Any]) -> list[Entry]:
    """The entry itself, then its ties."""
    ties = effect.get("ties") or []
    return [normal(entry["name"], entry["target"]) for entry in (effect, *ties)]


def score_case(key: Mapping[str, Any], diagnosis: Mapping[str, Any], cases: Path | None = None) -> dict[str, Any]:
    """One row of results.

    Args:
        key: the truth.
        diagnosis: by the contract.
        cases: folder of the cases, for the regions; left out without it.
    """
    truths = [normal(effect["name"], effect["target"]) for effect in key["effects"]]
    said = [options(effect) for effect in diagnosis.get("effects") or []]
    row: dict[str, Any] = {part: key[part] for part in ("case", "kind", "system", "loop", "rate", "chi2_per_dof")}
    row |= {"verdict": diagnosis["verdict"], "concealments": key["concealments"], "truths": truths, "said": said}
    row["noise"] = float(np.mean(list(key["noise"].values())))
    row["detected"] = bool(diagnosis["mismatch"]["detected"])
    row["ties"] = float(np.mean([len(entries) for entries in said])) if said else np.nan
    row |= _names(key, truths, said, diagnosis["verdict"])
    row["placed"] = _placed(key, truths, diagnosis)
    row["parameters"] = _parameters(key, diagnosis)
    claims = zip(diagnosis.get("effects") or [], row["right"], strict=True)
    row["probability"] = [(float(e["probability"]), good) for e, good in claims if e.get("probability") is not None]
    holdout = (diagnosis.get("fit") or {}).get("holdout") or {}
    for measure in ("one_step", "free_run"):
        values = holdout.get(measure) or {}
        after, noise = values.get("after"), values.get("noise")
        row[measure] = after / noise if after is not None and noise else np.nan
    areas, shares = _regions(key, diagnosis, cases) if cases else ([], [])
    row["auc"] = areas
    if any(share < 0.05 for share in shares):
        row["concealments"] = [*row["concealments"], "rare"]
    return row


def _names(key: Mapping[str, Any], truths: list[Entry], said: list[list[Entry]], verdict: str) -> dict[str, Any]:
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
    complete = listed and bool(truths)
    return {
        "right": [good or tuned for good, tuned in zip(right, excused, strict=True)],
        "found": found,
        "wrong": wrong,
        "exact": complete and claims and all(first) and not wrong,
        "tied": complete and claims and all(found) and not wrong,
        "any_wrong": claims and bool(wrong),
        "false_alarm": not truths and (verdict != "none" or bool(said)),
        "abstained": not claims,
    }


def _joint(target: str, key: Mapping[str, Any]) -> set[str]:
    """Joints where an effect on this target can show."""
    machine = key["machine"]
    kind, _, name = target.partition(":")
    if kind == "actuator":
        return {machine["motors"].get(name, "?")}
    if kind == "body":
        return set(machine["joints"][: machine["bodies"].index(name) + 1]) if name in machine["bodies"] else set()
    if kind == "world":
        return set(machine["joints"])
    return {normal("", target)[1].partition(":")[2]}


def _placed(key: Mapping[str, Any], truths: list[Entry], diagnosis: Mapping[str, Any]) -> float:
    """Share of the truths whose joint is among as many first places (nan without places or truths)."""
    places = [place["target"] for place in diagnosis.get("location") or []]
    if not truths or not diagnosis["mismatch"]["detected"]:
        return np.nan
    joints = set().union(*(_joint(place, key) for place in places[: len(truths)]), set())
    return float(np.mean([bool(_joint(target, key) & joints) for _, target in truths]))


def _parameters(key: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Relative error and whether the interval covers, for every parameter that both name."""
    rows = []
    for truth in key["effects"]:
        for effect in diagnosis.get("effects") or []:
            if normal(effect["name"], effect["target"]) != normal(truth["name"], truth["target"]):
                continue
            for name, entry in (effect.get("parameters") or {}).items():
                if name not in truth["parameters"]:
                    continue
                value, true = _pair(name, entry, truth)
                low, high = (bound + value - entry["value"] for bound in entry.get("ci95") or (np.nan, np.nan))
                rows.append({
                    "effect": truth["name"], "parameter": name, "error": abs(value - true) / max(abs(true), 1e-12),
                    "covered": bool(low <= true <= high) if np.isfinite(low + high) else None,
                })  # fmt: skip
    return rows


def _pair(name: str, entry: Mapping[str, Any], truth: Mapping[str, Any]) -> tuple[float, float]:
    """Value and truth in the same terms: phases to the nearest turn, a slip as a distance where that is nearer."""
    value, true = float(entry["value"]), float(truth["parameters"][name]["value"])
    if name == "phase":
        value += 2 * np.pi * round((true - value) / (2 * np.pi))
    if name == "slip" and entry.get("unit") in ("rad", "m"):
        true /= float(truth["parameters"]["stiffness"]["value"])
    return value, true


def _regions(key: Mapping[str, Any], diagnosis: Mapping[str, Any], cases: Path) -> tuple[list[float], list[float]]:
    """For each local effect: the area under the curve with which the region tells its rows, and their share."""
    areas, shares = [], []
    for effect in key["effects"]:
        if not effect.get("region"):
            continue
        joints = _joint(effect["target"], key)
        places = [place for place in diagnosis.get("location") or [] if _joint(place["target"], key) & joints]
        table = pd.concat([pd.read_csv(path) for path in sorted((cases / key["case"]).glob("train_*.csv"))])
        inside = _inside(table, effect["region"])
        shares.append(float(inside.mean()))
        if inside.any() and not inside.all():
            region = places[0].get("region") if places else None
            guess = _inside(table, region) if region else np.ones(len(table), bool)
            areas.append(area(inside, guess.astype(float)))
    return areas, shares


def _inside(table: pd.DataFrame, region: Mapping[str, Sequence[float]]) -> np.ndarray:
    inside = np.ones(len(table), bool)
    for name, (low, high) in region.items():
        plain = name.strip("|")
        if plain in table:
            values = table[plain].to_numpy()
        elif plain.replace("qvel", "qpos") in table:  # no tachometer: differences over five rows
            q, t = table[plain.replace("qvel", "qpos")].to_numpy(), table["time"].to_numpy()
            values = np.zeros(len(q))
            values[2:-2] = (q[4:] - q[:-4]) / np.maximum(t[4:] - t[:-4], 1e-9)
        else:
            continue
        values = np.abs(values) if name.startswith("|") else values
        inside &= (values >= low) & (values <= high)
    return inside


def area(truth: np.ndarray, score: np.ndarray) -> float:
    """Area under the receiver's curve; ties count one half."""
    ranks, positive = rankdata(score), int(truth.sum())
    return float((ranks[truth].sum() - positive * (positive + 1) / 2) / (positive * (len(truth) - positive)))


def score_all(out: Path, way: str = "diagnosis") -> tuple[list[dict[str, Any]], list[str]]:
    """Score every case that was run, and list those that were not; one that failed counts as a wrong answer."""
    rows, missing = [], []
    for path in sorted((out / "keys").glob("*.json")):
        result = out / "results" / way / path.stem / "diagnosis.json"
        failed = result.with_name("failed.txt").exists()
        if not result.exists() and not failed:
            missing.append(path.stem)
            continue
        key = json.loads(path.read_text(encoding="utf-8"))
        answer = json.loads(result.read_text(encoding="utf-8")) if result.exists() else FAILED
        row = score_case(key, answer, out / "cases")
        seconds = result.with_name("seconds.json")
        row["seconds"] = json.loads(seconds.read_text(encoding="utf-8")) if seconds.exists() else np.nan
        rows.append(row)
    return rows, missing
