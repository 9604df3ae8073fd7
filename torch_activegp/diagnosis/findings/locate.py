"""Where the mismatch lives: joint, time, and region of position, velocity and control."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy import stats

from torch_activegp.diagnosis.inputs.runs import Array, input_addresses
from torch_activegp.diagnosis.shooting.elimination import gained_by, invert, project
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import Linearization, linearize
from torch_activegp.physics.effect import Acting, Effect

BINS = 14
_RATE = 0.05
_ENERGY = 0.85
_WHOLE = 0.75
_NEARLY = 0.7


@dataclasses.dataclass(frozen=True)
class Region:
    """The residual force on one joint over one variable.

    Args:
        joint: which joint.
        over: canonical name of the variable, for example ``qvel.elbow``.
        edges: of the bins, ``(n + 1,)``.
        force: residual force in each bin, N m or N, ``(n,)``.
        spread: its standard deviation, ``(n,)``.
        count: intervals in each bin, ``(n,)``.
        gain: what a force in these bins would explain.
        p_value: that it is noise.
        adjusted: false-discovery-rate adjusted p-value.
        reach: least and largest value of the variable; the first and the last bin hold what lies beyond the edges too.
    """

    joint: str
    over: str
    edges: Array
    force: Array
    spread: Array
    count: Array
    gain: float
    p_value: float
    adjusted: float = 1.0
    reach: tuple[float, float] = (np.inf, -np.inf)

    @property
    def bounds(self) -> Array:
        """The edges, the outer ones as far out as anything was seen, ``(n + 1,)``."""
        first, last = min(self.reach[0], self.edges[0]), max(self.reach[1], self.edges[-1])
        return np.array([first, *self.edges[1:-1], last])

    def energy(self, low: float, high: float) -> float:
        """Energy of the force in an interval, evenly spread in each bin."""
        begin, end = self.bounds[:-1], self.bounds[1:]
        inside = np.clip(np.minimum(end, high) - np.maximum(begin, low), 0.0, None) / (end - begin)
        return float((self.force**2 * self.count * inside).sum())

    @property
    def interval(self) -> tuple[float, float] | None:
        """The shortest run of bins with most of the force's energy; None where that is nearly the whole range."""
        energy = np.maximum(self.force**2 - self.spread**2, 0.0) * self.count
        total = energy.sum()
        if total <= 0:
            return None
        n = len(energy)
        cells = [(a, b) for a in range(n) for b in range(a + 1, n + 1) if energy[a:b].sum() >= _ENERGY * total]
        a, b = min(cells, key=lambda cell: self.edges[cell[1]] - self.edges[cell[0]])
        if self.edges[b] - self.edges[a] > _WHOLE * (self.edges[-1] - self.edges[0]):
            return None
        return float(self.bounds[a]), float(self.bounds[b])


def locate(shooting: Shooting, fit: Fit, bins: Sequence[Region] = ()) -> list[Region]:
    """Residual forces in bins of every variable on every recorded joint, on top of a fit.

    Args:
        shooting: the likelihood.
        fit: the set.
        bins: regions of another fit, whose edges these have too; else every bin holds about enough of this one.

    Reference: Benjamini, Hochberg, *Controlling the False Discovery Rate*, J. of the Royal Statistical Society B 57
    (1995).
    """
    linear = linearize(shooting, fit)
    variables = _variables(shooting, linear)
    residual = shooting.residual_of(fit)
    starts = shooting.whiten_columns(linear.respond_to_start())
    regions, seen, known = [], _seen(shooting), {region.over: region.edges for region in bins}
    for channel, joint in enumerate(shooting.engine.channels.joints):
        for over, values in variables.items():
            edges = known[over] if over in known else _edges(values)
            which = np.clip(np.digitize(values, edges[1:-1]), 0, len(edges) - 2)
            indicators = np.eye(len(edges) - 1)[which]
            columns = shooting.whiten_columns(linear.respond_to_force(channel, indicators))
            normal, gradient = project(starts, columns, residual)
            gain, force = gained_by(normal, gradient)
            spread = np.sqrt(np.maximum(np.diag(invert(normal, 1e-8)), 0.0))
            count = indicators.sum(axis=(0, 1))
            p_value = float(stats.chi2.sf(gain, len(force)))
            regions.append(Region(joint, over, edges, force, spread, count, gain, p_value, reach=seen[over]))
    adjusted = stats.false_discovery_control([max(r.p_value, 1e-300) for r in regions])
    return [dataclasses.replace(r, adjusted=float(a)) for r, a in zip(regions, adjusted, strict=True)]


def somewhere(named: Sequence[tuple[Effect, Array]]) -> dict[str, Acting]:
    """Where named effects act that do so only somewhere; the first one of each joint.

    Args:
        named: effects with their parameters.
    """
    found: dict[str, Acting] = {}
    for effect, values in named:
        acting = effect.acts(values)
        if acting is not None:
            found.setdefault(acting.joint, acting)
    return found


def entries(
    regions: Sequence[Region], mismatch: float, known: Mapping[str, Acting] = MappingProxyType({})
) -> list[dict[str, Any]]:
    """The ``location`` of ``diagnosis.json``: the best variable of every joint where something is.

    The share of a joint is what a force on it alone would explain, at most all; those that would explain more come
    first, also where each would explain all of a mismatch that is small beside the noise. A joint where a named effect
    acts in two intervals has two entries, each with its part of the share; the second ones come last. It has them
    though no bins show it, as of a stop that is struck once: then their ``q_value`` says so.

    Args:
        regions: of :func:`locate`.
        mismatch: chi2 of the nominal above the noise.
        known: where named effects act; says more than bins do.
    """
    out: list[tuple[int, float, dict[str, Any]]] = []
    for joint in dict.fromkeys(region.joint for region in regions):
        named = _known(joint, regions, known)
        own = [r for r in regions if r.joint == joint and r.adjusted < _RATE] or ([named[0]] if named else [])
        if not own:
            continue
        best = max(own, key=lambda r: r.gain - len(r.force))
        explained = float(best.gain - len(best.force))
        share = float(np.clip(explained / max(mismatch, 1e-300), 0.0, 1.0))
        chosen, within = named or _local(best, own)
        parts = [chosen.energy(*interval) for interval in within]
        for number, (interval, part) in enumerate(zip(within, parts, strict=True)):
            its = part / sum(parts) if sum(parts) > 0.0 else 1.0 / len(parts)
            region = {chosen.over: list(interval)}
            entry = {"target": f"joint:{joint}", "share": share * its, "region": region, "q_value": chosen.adjusted}
            out.append((number, -explained, entry))
    return [entry for _, _, entry in sorted(out, key=lambda item: item[:2])]


def _known(
    joint: str, regions: Sequence[Region], known: Mapping[str, Acting]
) -> tuple[Region, list[tuple[float, float]]] | None:
    """Where a named effect acts on a joint, as far as that was seen."""
    if joint not in known:
        return None
    _, over, within = known[joint]
    for seen in regions:
        if (seen.joint, seen.over) == (joint, over):
            first, *_, last = map(float, seen.bounds)
            cut = [(max(low, first), min(high, last)) for low, high in within]
            inside = [(low, high) for low, high in cut if low < high]
            return (seen, inside) if inside else None
    return None


def _local(best: Region, own: Sequence[Region]) -> tuple[Region, list[tuple[float, float]]]:
    """Of the variables that explain nearly as much as the best one, one whose force is only somewhere."""
    local = [r for r in own if r.interval is not None and r.gain > _NEARLY * best.gain]
    chosen = max(local, key=lambda r: r.gain) if local else best
    return chosen, [chosen.interval or (float(chosen.bounds[0]), float(chosen.bounds[-1]))]


def _variables(shooting: Shooting, linear: Linearization) -> dict[str, Array]:
    """Position and velocity of each recorded joint and each control, in every interval, ``(S, K)``."""
    engine = shooting.engine
    out = {}
    for kind, addresses in (("qpos", linear.positions), ("qvel", linear.velocities)):
        for joint, address in zip(engine.channels.joints, addresses, strict=True):
            along = np.nan_to_num(linear.states[..., address])
            out[f"{kind}.{joint}"] = 0.5 * (along[:, 1:] + along[:, :-1])
    return out | _controls(shooting)


def _seen(shooting: Shooting) -> dict[str, tuple[float, float]]:
    """Least and largest position and velocity of each recorded joint and control in the recordings."""
    engine, segments = shooting.engine, shooting.segments
    joints = engine.channels.joints
    columns = {f"qpos.{joint}": segments.take("smooth")[..., c] for c, joint in enumerate(joints)}
    columns |= {f"qvel.{joint}": segments.take("velocity")[..., c] for c, joint in enumerate(joints)}
    columns |= _controls(shooting)
    return {name: (float(values.min()), float(values.max())) for name, values in columns.items()}


def _controls(shooting: Shooting) -> dict[str, Array]:
    """Each control that changes, in every interval, ``(S, K)``."""
    model, control, out = shooting.engine.model, shooting.segments.take("control"), {}
    for name, first in input_addresses(model).items():
        if np.ptp(control[..., first]) > 0:
            out[f"ctrl.{name}"] = control[..., first]
    return out


def _edges(values: Array) -> Array:
    """Bins of equal width over the middle 99 %, wider where fewer than 1 in 200 samples are."""
    low, high = np.quantile(values, [0.005, 0.995])
    if not high > low:
        low, high = float(values.min()) - 1e-9, float(values.max()) + 1e-9
    edges = [float(low)]
    for edge in np.linspace(low, high, BINS + 1)[1:-1]:
        inside = ((values >= edges[-1]) & (values < edge)).mean()
        if inside > 0.005:
            edges.append(float(edge))
    return np.array([*edges, float(high)])
