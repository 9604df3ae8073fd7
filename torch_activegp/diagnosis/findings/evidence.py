"""What the report draws: the mismatch in time and in regions, and each law over the residual force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from torch_activegp.diagnosis.findings.locate import Region
from torch_activegp.diagnosis.inputs.runs import Array, Channels
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.joint import JointEffect


def map_time(shooting: Shooting, before: Fit, after: Fit) -> list[dict[str, Any]]:
    """Chi2 per sample of every segment, before and after, with its centre and its length, s."""
    segments = shooting.segments
    centers = segments.centers()
    ends = [segments.runs[r].time[rows] for r, rows in zip(segments.run, segments.scored, strict=True)]
    seconds = np.diff(np.array(ends), axis=1)[:, 0]
    samples = segments.samples
    out = []
    for number, run in enumerate(segments.runs):
        own = np.flatnonzero(segments.run == number)
        out.append(
            {
                "run": run.label,
                "time": centers[own].round(4).tolist(),
                "seconds": seconds[own].round(4).tolist(),
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


def laws(channels: Channels, left: Sequence[Region], fit: Fit, named: Sequence[Effect]) -> list[dict[str, Any]]:
    """For every named force law: the law, and over it the force that is missing without it.

    The points are partial residuals: the law amid each bin, and the force that the whole set leaves there. A simulation
    without the law leaves its segments; the force by which it does so is no longer one on the recorded motion.

    Args:
        channels: the recorded joints.
        left: the force that the whole set leaves, :func:`~torch_activegp.diagnosis.findings.locate.locate`.
        fit: the whole set.
        named: effects of it.

    Reference: Larsen, McCleary, *The Use of Partial Residual Plots in Regression Analysis*, Technometrics 14 (1972).
    """
    out = []
    regions = {(region.joint, region.over): region for region in left}
    values = fit.by_effect
    for effect in named:
        if not isinstance(effect, JointEffect) or effect.name in ("armature_error", "hysteresis"):
            continue
        joint = effect.target.partition(":")[2]
        by_position = _is_of_position(effect, values[effect], regions, joint)
        over = f"{'qpos' if by_position else 'qvel'}.{joint}"
        region = regions[joint, over]

        def law(x: Array, effect: JointEffect = effect, by_position: bool = by_position) -> Array:
            return _law(effect, values[effect], x, by_position)

        amid = 0.5 * (region.edges[:-1] + region.edges[1:])
        x = np.linspace(region.bounds[0], region.bounds[-1], 201)  # a stop is met beyond the last edge
        length = channels.units[channels.joints.index(joint)]
        force = {"rad": "N m", "m": "N"}[length] if "N" in effect.parameters[0].unit else f"{length}/s2"
        out.append(
            {
                "name": effect.name,
                "target": effect.target,
                "over": over,
                "unit_x": length if by_position else f"{length}/s",
                "unit_y": force,
                "x": amid.tolist(),
                "force": (region.force + law(amid)).tolist(),
                "force_sd": region.spread.tolist(),
                "law_x": x.tolist(),
                "law_y": law(x).tolist(),
            }
        )
    return out


def _law(effect: JointEffect, values: Array, x: Array, by_position: bool) -> Array:
    """The force over positions at rest, or over velocities at zero."""
    motion = (x, np.zeros_like(x)) if by_position else (np.zeros_like(x), x)
    return np.asarray(effect.force(*motion, values))


def _is_of_position(effect: JointEffect, values: Array, regions: Mapping[tuple[str, str], Region], joint: str) -> bool:
    """Whether a law changes more over the recorded positions than over the velocities."""
    spans = [
        float(np.ptp(_law(effect, values, np.linspace(*regions[joint, f"{kind}.{joint}"].reach, 201), kind == "qpos")))
        for kind in ("qpos", "qvel")
    ]
    return spans[0] >= spans[1]
