"""An effect that acts on the inertia of one body."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Effect, element

AXES = "xyz"
_INERTIAL = ("body_mass", "body_ipos", "body_inertia", "body_iquat", "body_simple")


@dataclasses.dataclass(frozen=True, eq=False)
class BodyEffect(Effect):
    """Base of the effects on a body.

    Args:
        body: the body's id.
        offset: where a payload sits from the body's centre of mass, m, body frame, ``(3,)``.
        axes: directions of the centre's displacement: 0, 1 and 2 for x, y and z of the body's frame.
    """

    body: int = 0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: tuple[int, ...] = (0,)

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``inertial`` as the edited model has it, unless the compiler would overrule it."""
        options = spec.compiler
        overruled = options.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        if overruled or options.settotalmass > 0.0 or options.fusestatic:
            return False
        model = spec.copy().compile()
        fields = {name: getattr(model, name)[None].copy() for name in _INERTIAL}
        self.edit(fields.__getitem__, np.array([0]), np.asarray(values, dtype=float)[None])
        body: mujoco.MjsBody = element(spec, spec.bodies, self.target)
        mass, center, inertia, axes, _ = (fields[name][0, self.body] for name in _INERTIAL)
        body.explicitinertial, body.fullinertia[0] = True, np.nan
        body.mass, body.ipos, body.inertia, body.iquat = float(mass), center, inertia, axes
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        return True
