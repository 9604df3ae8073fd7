"""The claims of the paper, each held or not held on our runs."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import pandas as pd


@dataclass(frozen=True)
class Claim:
    """One claim and what we saw.

    Attributes:
        text: the claim.
        seen: the figures, mean [min, max] over the trials.
        held: whether the means agree with the claim.
    """

    text: str
    seen: str
    held: bool


def check_claims(table: pd.DataFrame) -> list[Claim]:
    """Check the paper's claims that the table has the methods for.

    Args:
        table: from :func:`~torch_activegp.experiments.records_table`.

    Returns:
        The claims, in the paper's order.
    """
    present = set(table["method"])
    claims = []
    if {"discrepancy", "opax"} <= present:
        claims.append(_first_episode(table))
        claims.append(_comparable_variance(table))
    if {"discrepancy", "opax", "sigma"} <= present:
        claims.append(_sigma_lowest(table))
        claims.append(_discrepancy_highest(table))
    return claims


def _first_episode(table: pd.DataFrame) -> Claim:
    first = table[table["episode"] == 1]
    ours, theirs = _trials(first, "discrepancy", "mse"), _trials(first, "opax", "mse")
    return Claim(
        "After the first episode the error is far below that of OpAx without the prior (at most a tenth).",
        f"{_show(ours)} against {_show(theirs)}: {theirs.mean() / ours.mean():.0f} times lower",
        bool(ours.mean() <= theirs.mean() / 10),
    )


def _comparable_variance(table: pd.DataFrame) -> Claim:
    last = table[table["episode"] == table["episode"].max()]
    ours, theirs = _trials(last, "discrepancy", "max_variance"), _trials(last, "opax", "max_variance")
    return Claim(
        "The maximum variance after the last episode is comparable to that of OpAx (within 10 %).",
        f"{_show(ours)} against {_show(theirs)}",
        bool(abs(ours.mean() / theirs.mean() - 1) <= 0.1),
    )


def _sigma_lowest(table: pd.DataFrame) -> Claim:
    last = table[table["episode"] == table["episode"].max()]
    values = {name: _trials(last, name, "max_variance") for name in ("sigma", "discrepancy", "opax")}
    return Claim(
        "Sigma-greedy ends with the lowest maximum variance.",
        "; ".join(f"{name} {_show(value)}" for name, value in values.items()),
        bool(min(values, key=lambda name: values[name].mean()) == "sigma"),
    )


def _discrepancy_highest(table: pd.DataFrame) -> Claim:
    values = {name: _trials(table, name, "discrepancy") for name in ("discrepancy", "opax", "sigma")}
    return Claim(
        "The mean discrepancy at visited points is above both baselines'.",
        "; ".join(f"{name} {_show(value)}" for name, value in values.items()),
        bool(max(values, key=lambda name: values[name].mean()) == "discrepancy"),
    )


def _trials(table: pd.DataFrame, method: str, column: str) -> pd.Series:
    return table[table["method"] == method].groupby("trial")[column].mean()


def _show(values: pd.Series) -> str:
    return f"{values.mean():.3g} [{values.min():.3g}, {values.max():.3g}]"


def claims_as_dicts(claims: list[Claim]) -> list[dict[str, object]]:
    """Plain values, for JSON."""
    return [asdict(claim) for claim in claims]
