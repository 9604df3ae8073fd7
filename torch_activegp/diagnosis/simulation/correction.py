"""The corrected simulator: effects written into the MJCF file, and what it cannot hold said."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.simulation.explicit_damping import make_explicit
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.friction import write_sharp


class Form(NamedTuple):
    """How a fit integrated a model, where that is not the model's own way.

    Args:
        integrator: one of ``mujoco.mjtIntegrator``.
        step: time step, s.
        firm: whether the dry friction of the model's own joints stuck firmly.
        explicit: whether semi-implicit Euler took damping at the speed that a step begins with.
    """

    integrator: int
    step: float
    firm: bool = False
    explicit: bool = False

    def write(self, spec: mujoco.MjSpec) -> None:
        """Lets a model that is being edited integrate so."""
        spec.option.integrator, spec.option.timestep = self.integrator, self.step
        if self.explicit:
            make_explicit(spec.option)
        for joint in spec.joints if self.firm else ():
            if joint.frictionloss > 0.0:
                write_sharp(joint, self.step)


def corrected_xml(
    spec: mujoco.MjSpec | None,
    effects: Sequence[Effect],
    values: Sequence[Array],
    numerics: Form | None,
) -> tuple[str | None, list[bool | None], str | None]:
    """Writes effects into a model.

    Args:
        spec: the nominal model; it is left as it is. None for a simulator that is none in MJCF.
        effects: what to write.
        values: their parameters.
        numerics: how the fit integrated, where that is not the model's own way.

    Returns:
        The MJCF text, or None if no effect could be written; whether each effect is in it, None without a nominal; the
        unified difference from the nominal.
    """
    if spec is None:
        return None, [None] * len(effects), None
    before = spec.to_xml()
    edited = spec.copy()
    if numerics is not None:  # first: the softness of dry friction and the shortest delay are those of its time step
        numerics.write(edited)
    held: list[bool | None] = [None] * len(effects)
    for i in sorted(range(len(effects)), key=lambda i: effects[i].order):  # a drive's in their chain
        held[i] = effects[i].write(edited, np.asarray(values[i]))
    if effects and not any(held):
        return None, held, None
    try:
        edited.compile()
    except ValueError:
        return None, [False] * len(held), None
    after = edited.to_xml()
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), "nominal", "corrected", lineterm="")
    return after, held, "\n".join(lines)
