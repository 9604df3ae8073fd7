"""
An effect of your own
=====================

The catalogue knows friction, springs, delays and more. Your machine has something else: a brush that drags only where
the arm passes it. Say the law in a dozen lines, and it is simulated, screened and fitted like the built-in effects.
"""

# %%
# The law
# -------
# A force on one joint is a :class:`~torch_activegp.physics.joint.JointEffect`. It has a ``name``, a ``law`` for people,
# a constructor ``at`` that sizes its parameters for a place on a machine, and a ``force``. The first ``linear``
# parameters are amplitudes, at which 0 means absent; of the others, ``seeds`` are values from which to search.

from collections.abc import Sequence
from typing import Self

import mujoco
import numpy as np

from torch_activegp.data import Recording
from torch_activegp.diagnosis import diagnose
from torch_activegp.physics import Parameter, Place
from torch_activegp.physics.joint import JointEffect


class Brush(JointEffect):
    """-c v exp(-((q - p) / w)^2): something that rubs where the arm passes it."""

    name = "brush"
    law = "-c v exp(-((q - p)/w)^2)"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Places to start from all over the recorded range, each a tenth of it wide."""
        low, high = place.position
        width, drag = 0.1 * (high - low), 0.1 * place.force / place.speed
        parameters = (
            Parameter("coefficient", f"{place.force_unit} s/{place.position_unit}", drag, low=0.0),
            Parameter("place", place.position_unit, 0.1 * width, low=low, high=high),
            Parameter("width", place.position_unit, 0.1 * width, low=0.1 * width, high=high - low),
        )
        return cls.make(place, parameters, [[drag, p, width] for p in np.linspace(low, high, 9)[1:-1]], linear=1)

    def force(
        self, position: np.ndarray, velocity: np.ndarray, values: Sequence[np.ndarray] | np.ndarray
    ) -> np.ndarray:
        """The law, N m; values are the parameters in their order, each a number or an array that broadcasts."""
        return -values[0] * velocity * np.exp(-(((position - values[1]) / values[2]) ** 2))


# %%
# A machine with a brush
# ----------------------
# The nominal model knows nothing of it. The recording comes from other code: a pendulum equation in small Euler steps.

XML = """
<mujoco><option timestep="0.002"/><worldbody><body><joint name="arm" axis="0 1 0" damping="0.02"/>
<geom type="sphere" size="0.01" pos="0 0 -0.5" mass="0.8"/></body></worldbody>
<actuator><motor name="motor" joint="arm"/></actuator></mujoco>"""
TRUE = {"coefficient": 0.15, "place": 0.4, "width": 0.2}

inertia = 0.8 * 0.5**2 + 0.4 * 0.8 * 0.01**2
rng = np.random.default_rng(0)
time = np.arange(0.0, 12.0, 0.02)
torque = 1.2 * np.sin(2.1 * time) + 1.0 * np.sin(5.3 * time)
angle, speed, positions = 0.0, 0.0, []
for u in torque:
    positions.append(angle)
    for _ in range(200):
        rubs = TRUE["coefficient"] * np.exp(-(((angle - TRUE["place"]) / TRUE["width"]) ** 2))
        push = u - 0.8 * 9.81 * 0.5 * np.sin(angle) - (0.02 + rubs) * speed
        speed += 1e-4 * push / inertia
        angle += 1e-4 * speed
noise = 5e-4
measured = np.array(positions) + noise * rng.normal(size=len(time))
recording = Recording.from_columns("swing", {"time": time, "qpos.arm": measured, "ctrl.motor": torque})

# %%
# Is it the brush?
# ----------------
# :func:`~torch_activegp.diagnosis.diagnose` tries the class on every recorded joint, beside its own list, and is not
# told that it is the one. It keeps the last fifth of the recording to forecast.

diagnosis = diagnose(XML, [recording], effects=[Brush], nthread=1)
print(diagnosis)

# %%
# What we claimed
# ---------------

(effect,) = diagnosis.effects
assert (diagnosis.verdict, effect.name, effect.target) == ("named", "brush", "joint:arm")
for name, true in TRUE.items():
    np.testing.assert_allclose(effect.parameters[name].value, true, rtol=0.1)
errors = diagnosis.details["fit"]["holdout"]["free_run"]
assert errors["after"] < 0.1 * errors["before"]
