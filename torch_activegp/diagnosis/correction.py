"""The corrected simulator: effects written into the MJCF file, and what it cannot hold said."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

import mujoco
import numpy as np

from torch_activegp.diagnosis.runs import Array
from torch_activegp.physics.effect import Effect


def corrected_xml(
    spec: mujoco.MjSpec | None,
    effects: Sequence[Effect],
    values: Sequence[Array],
    numerics: tuple[int, float] | None,
) -> tuple[str | None, list[bool | None], str | None]:
    """Writes effects into a model.

    Args:
        spec: the nominal model; it is left as it is. None for a simulator that is none in MJCF.
        effects: what to write.
        values: their parameters.
        numerics: integrator and time step that the fit used, where they are not the model's own.

    Returns:
        The MJCF text, or None if no effect could be written; whether each effect is in it, None without a nominal; the
        unified difference from the nominal.
    """
    if spec is None:
        return None, [None] * len(effects), None
    before = spec.to_xml()
    edited = spec.copy()
    if numerics is not None:  # first: the softness of dry friction and the shortest delay are those of its time step
        edited.option.integrator, edited.option.timestep = numerics
    held: list[bool | None] = [
        effect.write(edited, np.asarray(value)) for effect, value in zip(effects, values, strict=True)
    ]
    if effects and not any(held):
        return None, held, None
    try:
        edited.compile()
    except ValueError:
        return None, [False] * len(held), None
    after = edited.to_xml()
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), "nominal", "corrected", lineterm="")
    return after, held, "\n".join(lines)
