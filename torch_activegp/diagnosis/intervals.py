"""Intervals of the parameters."""

from __future__ import annotations

import numpy as np
from scipy import stats

from torch_activegp.diagnosis.elimination import eliminate, invert
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.result import Estimate
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.physics.effect import Effect

_LEVEL = 0.975
_RECORDINGS = 4
"""From so few on their spread says something."""
_WIDEST = 5.0
"""Ends at most 150 times the value away: more says no more."""


def covariance(shooting: Shooting, fit: Fit) -> Array:
    """Covariance of the parameters of a fit, ``(P, P)``.

    The largest, parameter by parameter, of three estimates: the inverse information times the variance that is left;
    the sandwich over segments, which holds where the noise is not what the likelihood says; and the jackknife over
    recordings, to first order, which holds where what is left of one is alike throughout.

    References:
        White, *Maximum Likelihood Estimation of Misspecified Models*, Econometrica 50 (1982).
        Hinkley, *Jackknifing in Unbalanced Situations*, Technometrics 19 (1977).
    """
    inverse = invert(fit.information)
    variance = max(fit.chi2 / max(shooting.dof - fit.size, 1), 1e-12)
    plain = variance * inverse
    others = [np.diag(each) for each in (_sandwich(fit, inverse), _jackknife(shooting, fit, inverse))]
    largest = np.maximum.reduce([np.diag(plain), *others])
    ratio = np.sqrt(largest / np.maximum(np.diag(plain), 1e-300))
    return plain * np.outer(ratio, ratio)


def _sandwich(fit: Fit, inverse: Array) -> Array:
    """Covariance by how much the segments' scores differ; zero where there are hardly more of them than parameters."""
    size = len(fit.scores)
    if size <= fit.size + 2:
        return np.zeros_like(inverse)
    return np.asarray(inverse @ (fit.scores.T @ fit.scores) @ inverse * size / (size - fit.size))


def _jackknife(shooting: Shooting, fit: Fit, inverse: Array) -> Array:
    """Covariance by how far the parameters would move without each recording.

    Zero where there are few recordings, or no derivatives to tell the information of each.
    """
    runs, index = np.unique(shooting.segments.run, return_inverse=True)
    if len(runs) < _RECORDINGS or fit.design is None or fit.columns is None:
        return np.zeros_like(inverse)
    normal = eliminate(fit.design, fit.columns, np.zeros(fit.design.shape[:2])).normal
    moves = []
    for number in range(len(runs)):
        out = index == number
        moves.append(invert(normal[~out].sum(axis=0)) @ fit.scores[out].sum(axis=0))
    return np.asarray(np.transpose(moves) @ np.stack(moves) * (len(runs) - 1) / len(runs))


def standard_errors(shooting: Shooting, fit: Fit, effect: Effect) -> dict[str, float]:
    """Standard errors of the parameters of one effect of a fit as its users know them (delta method)."""
    k = fit.effects.index(effect)
    first = sum(len(v) for v in fit.values[:k])
    values = fit.values[k]
    block = covariance(shooting, fit)[first : first + len(values), first : first + len(values)]
    center = effect.describe(values)
    steps = 1e-4 * np.maximum(np.abs(values), [p.scale for p in effect.parameters])
    moved = [effect.describe(values + step) for step in np.diag(steps)]
    out = {}
    for name, value in center.items():
        slope = np.array([(m[name] - value) / step for m, step in zip(moved, steps, strict=True)])
        out[name] = float(np.sqrt(max(slope @ block @ slope, 0.0)))
    return out


def estimates(shooting: Shooting, fit: Fit, effect: Effect) -> dict[str, Estimate]:
    """The parameters of one effect of a fit as its users know them, with 95 % intervals.

    Intervals by the logarithm: Meeker, Escobar, *Statistical Methods for Reliability Data* (1998).
    """
    wide = float(stats.t.ppf(_LEVEL, max(shooting.segments.size - fit.size, 3)))
    errors = standard_errors(shooting, fit, effect)
    center = effect.describe(fit.values[fit.effects.index(effect)])
    return {
        name: Estimate(
            value, _unit(effect, name, i), _interval(value, wide * errors[name], name in effect.never_negative)
        )
        for i, (name, value) in enumerate(center.items())
    }


def _interval(value: float, half: float, never_negative: bool) -> tuple[float, float]:
    """Symmetric, or by the logarithm for what is never negative: the same where it is certain."""
    if not never_negative:
        return value - half, value + half
    if value <= 0.0:
        return 0.0, value + half
    ratio = float(np.exp(min(half / value, _WIDEST)))
    return value / ratio, value * ratio


def _unit(effect: Effect, name: str, index: int) -> str:
    """The unit of a described parameter: that of the parameter of the same name, else of the one in its place."""
    units = {p.name: p.unit for p in effect.parameters}
    position = effect.parameters[0].unit.partition("/")[2] or "rad"
    for parameter in effect.parameters:  # of an acceleration
        position = parameter.unit.removesuffix("/s2") if parameter.unit in ("rad/s2", "m/s2") else position
    known = {"rest": position, "phase": "rad", "amplitude": effect.parameters[0].unit, "gain": "1"}
    return (
        units.get(name)
        or known.get(name.rstrip("_0123456789"))
        or effect.parameters[min(index, len(effect.parameters) - 1)].unit
    )
