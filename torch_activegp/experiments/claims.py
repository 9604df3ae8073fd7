"""The claims of the paper, and what our runs say about each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
import pandas as pd

Verdict = Literal["held", "not held", "not distinguishable yet"]

_OURS, _OPAX, _SIGMA = "discrepancy", "opax", "sigma"
_FACTOR = 10
"""How much lower the first episode's error must be."""
_COMPARABLE = 0.1
"""Relative difference up to which two variances are comparable."""
_FEWEST_TRIALS = 5
"""Trials below which the spread of a difference is not known."""
_TIE = 1e-3
"""Relative difference below which means are not told apart."""
_UNTOUCHED = 0.999
"""Largest variance, relative to the prior's, from which on a method has not yet reached every corner."""


@dataclass(frozen=True)
class Claim:
    """One claim and what we saw.

    Attributes:
        text: the claim.
        seen: the figures, mean [min, max] over the trials.
        verdict: whether the trials agree with the claim.
    """

    text: str
    seen: str
    verdict: Verdict


def check_claims(table: pd.DataFrame) -> list[Claim]:
    """Check the paper's claims that the table has the methods for.

    Args:
        table: from :func:`~torch_activegp.experiments.records_table`.

    Returns:
        The claims, in the paper's order.
    """
    present = set(table["method"])
    claims = []
    if {_OURS, _OPAX} <= present:
        claims += [_first_episode(table), _comparable_variance(table)]
    if {_OURS, _OPAX, _SIGMA} <= present:
        claims += [_sigma_lowest(table), _discrepancy_highest(table)]
    return claims


def _first_episode(table: pd.DataFrame) -> Claim:
    first = table[table["episode"] == 1]
    ours, theirs = _per_trial(first, _OURS, "mse"), _per_trial(first, _OPAX, "mse")
    ratio = theirs.mean() / ours.mean()
    return Claim(
        f"After the first episode the error is far below OpAx without the prior (at most 1/{_FACTOR} of its MSE).",
        f"MSE {_show(ours)} against {_show(theirs)}: {ratio:.3g} times lower",
        "held" if ratio >= _FACTOR else "not held",
    )


def _comparable_variance(table: pd.DataFrame) -> Claim:
    values = _last_variance(table, (_OURS, _OPAX))
    ours, theirs = (value.mean() for value in values.values())
    verdict: Verdict = "held" if abs(ours / theirs - 1) <= _COMPARABLE else "not held"
    return Claim(
        f"After the last episode the maximum variance is comparable to OpAx (within {_COMPARABLE:.0%}).",
        _list(values),
        "not distinguishable yet" if _untouched(values) else verdict,
    )


def _sigma_lowest(table: pd.DataFrame) -> Claim:
    values = _last_variance(table, (_SIGMA, _OURS, _OPAX))
    wins = (values[_SIGMA] < pd.concat([values[_OURS], values[_OPAX]], axis=1).min(axis=1)).sum()
    verdict = _first_is_largest({name: -value for name, value in values.items()})
    return Claim(
        "After the last episode sigma-greedy has the lowest maximum variance.",
        f"{_list(values)}; lowest in {wins} of {len(values[_SIGMA])} trials",
        "not distinguishable yet" if _untouched(values) else verdict,
    )


def _discrepancy_highest(table: pd.DataFrame) -> Claim:
    values = {name: _per_trial(table, name, "discrepancy") for name in (_OURS, _OPAX, _SIGMA)}
    wins = (values[_OURS] > pd.concat([values[_OPAX], values[_SIGMA]], axis=1).max(axis=1)).sum()
    return Claim(
        "The mean discrepancy |p0 - f| at visited points, over all episodes, is above both baselines.",
        f"{_list(values)}; highest in {wins} of {len(values[_OURS])} trials",
        _first_is_largest(values),
    )


def _first_is_largest(values: dict[str, pd.Series]) -> Verdict:
    """Whether the first method's mean is above each other's by two standard errors of the difference within trials."""
    first, *others = (np.asarray(value, dtype=float) for value in values.values())
    if len(first) < _FEWEST_TRIALS:
        return "not distinguishable yet"
    gaps = np.stack([first - other for other in others], axis=1)
    margin = np.maximum(2 * gaps.std(axis=0, ddof=1) / len(gaps) ** 0.5, _TIE * abs(first.mean()))
    if (gaps.mean(axis=0) < -margin).any():
        return "not held"
    return "held" if (gaps.mean(axis=0) > margin).all() else "not distinguishable yet"


def _untouched(values: dict[str, pd.Series]) -> bool:
    """Whether the largest variance is still the prior's in every method, so that all ties mean nothing."""
    return all(value.mean() >= _UNTOUCHED for value in values.values())


def _last_variance(table: pd.DataFrame, methods: Sequence[str]) -> dict[str, pd.Series]:
    last = table[table["episode"] == table["episode"].max()]
    return {name: _per_trial(last, name, "max_variance") for name in methods}


def _per_trial(table: pd.DataFrame, method: str, column: str) -> pd.Series:
    return table[table["method"] == method].groupby("trial")[column].mean()


def _list(values: dict[str, pd.Series]) -> str:
    return "; ".join(f"{name} {_show(value)}" for name, value in values.items())


def _show(values: pd.Series) -> str:
    return f"{values.mean():.3g} [{values.min():.3g}, {values.max():.3g}]"


def claims_as_dicts(claims: Sequence[Claim]) -> list[dict[str, object]]:
    """Plain values, for JSON."""
    return [asdict(claim) for claim in claims]


def claims_as_markdown(claims: Sequence[Claim], title: str) -> str:
    """A Markdown page with one table.

    Args:
        claims: what was checked.
        title: the runs that it was checked on.
    """
    cells = [[cell.replace("|", "\\|") for cell in (claim.text, claim.seen, claim.verdict)] for claim in claims]
    rows = [f"| {text} | {seen} | {verdict} |" for text, seen, verdict in cells]
    rows = rows or ["| none: the methods of the claims (discrepancy, opax, sigma) were not all run | | |"]
    head = [f"# The paper's claims on {title}", "", "Figures are mean [min, max] over the trials.", ""]
    return "\n".join([*head, "| claim | seen | verdict |", "|---|---|---|", *rows, ""])
