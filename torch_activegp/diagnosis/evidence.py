"""What the report draws: the mismatch in time and in regions, and each law over the residual force."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.locate import Region, locate
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.joint import JointEffect

_POSITION_LAWS = frozenset({"linear_spring", "cubic_spring", "constant_force", "cogging", "joint_stop"})


def map_time(shooting: Shooting, before: Fit, after: Fit) -> list[dict[str, Any]]:
    """Chi2 per sample of every segment, before and after."""
    segments = shooting.segments
    centers = segments.centers()
    samples = segments.samples
    out = []
    for number, run in enumerate(segments.runs):
        own = np.flatnonzero(segments.run == number)
        out.append(
            {
                "run": run.label,
                "time": centers[own].round(4).tolist(),
                "before": (before.per_segment[own] / samples[own]).tolist(),
                "after": (after.per_segment[own] / samples[own]).tolist(),
            }
        )
    return out


def map_region(before: Sequence[Region], after: Sequence[Region]) -> list[dict[str, Any]]:
    """Mean squared residual force in units of its standard deviation, in bins, before and after."""
    later = {(region.joint, region.over): region for region in after}
    out = []
    for region in before:
        other = later[region.joint, region.over]
        if len(other.force) != len(region.force):
            continue
        scale = np.maximum(region.spread, 1e-300)
        out.append(
            {
                "channel": f"joint:{region.joint}",
                "over": region.over,
                "edges": region.edges.tolist(),
                "before": ((region.force / scale) ** 2).tolist(),
                "after": ((other.force / scale) ** 2).tolist(),
                "count": region.count.astype(int).tolist(),
            }
        )
    return out


def laws(shooting: Shooting, fit: Fit, named: Sequence[Effect]) -> list[dict[str, Any]]:
    """For every named force law: the force that is missing without it, and the law."""
    out = []
    for effect in named:
        if not isinstance(effect, JointEffect) or effect.name in ("armature_error", "hysteresis"):
            continue
        k = fit.effects.index(effect)
        less = dataclasses.replace(
            fit,
            effects=tuple(e for e in fit.effects if e is not effect),
            values=tuple(v for i, v in enumerate(fit.values) if i != k),
        )
        joint = effect.target.partition(":")[2]
        by_position = effect.name in _POSITION_LAWS
        over = f"{'qpos' if by_position else 'qvel'}.{joint}"
        regions = [r for r in locate(shooting, less) if r.joint == joint and r.over == over]
        if not regions:
            continue
        region = regions[0]
        x = np.linspace(region.edges[0], region.edges[-1], 201)
        zero = np.zeros_like(x)
        y = effect.force(x, zero, fit.values[k]) if by_position else effect.force(zero, x, fit.values[k])
        length = shooting.engine.channels.units[shooting.engine.channels.joints.index(joint)]
        force = {"rad": "N m", "m": "N"}[length] if "N" in effect.parameters[0].unit else f"{length}/s2"
        out.append(
            {
                "name": effect.name,
                "target": effect.target,
                "over": over,
                "unit_x": length if by_position else f"{length}/s",
                "unit_y": force,
                "x": (0.5 * (region.edges[1:] + region.edges[:-1])).tolist(),
                "force": region.force.tolist(),
                "force_sd": region.spread.tolist(),
                "law_x": x.tolist(),
                "law_y": np.asarray(y).tolist(),
            }
        )
    return out
