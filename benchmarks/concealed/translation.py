"""The key's words for an effect in those of the package's effects, and back: the only place that knows both.

| effect | in the key | what the package's effect holds |
|---|---|---|
| stribeck_friction | coulomb, static | coulomb, static - coulomb |
| linear_spring | stiffness, rest | stiffness, stiffness x rest |
| cogging | amplitude, phase at zero | amplitudes of sine and cosine about the middle of the range |
| joint_stop | position | distance of an upper or a lower stop |
| hysteresis | slip as a force | slip as a distance |
| gains | gain | gain - 1 |
| center_of_mass_offset, gravity_error | a vector | one effect an axis |
| payload_mass | at the centre of mass or as far behind it | at the centre of mass, at the end, or everywhere |
| actuator_saturation of a servo | of its force | of its force, and in another form of its control |
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from torch_activegp.physics import Effect, Place
from torch_activegp.physics.cogging import ENDINGS, Cogging
from torch_activegp.physics.effect import Array
from torch_activegp.physics.payload import PayloadMass

Form = list[tuple[Effect, Array]]
"""Effects and their values: one way in which the package can hold something."""

_VECTORS = ("center_of_mass_offset", "gravity_error")


def described(truth: Mapping[str, Any]) -> dict[str, float]:
    """True parameters as the package would say them."""
    values = {name: float(entry["value"]) for name, entry in truth["parameters"].items()}
    if truth["name"] == "hysteresis":
        values["slip"] /= values["stiffness"]
    return values


def values_of(effect: Effect, words: Mapping[str, float]) -> Array | None:
    """The values for which ``effect.describe`` gives these words, or None where it has other words."""
    names = [parameter.name for parameter in effect.parameters]
    spoken = effect.describe(effect.seeds[0])
    if set(spoken) != set(words):
        return None
    special: dict[str, Callable[[], list[float]]] = {
        "stribeck_friction": lambda: [
            words["coulomb"], words["static"] - words["coulomb"], *(words[name] for name in names[2:]),
        ],
        "cogging": lambda: _waves(effect, words),
        "joint_stop": lambda: [
            words["stiffness"], words["damping"], words["position"] * (1.0 if effect.variant == "upper" else -1.0),
        ],
        "linear_spring": lambda: [words["stiffness"], words["stiffness"] * words["rest"]][: len(names)],
        "actuator_gain": lambda: [words["gain"] - 1.0],
        "sensor_gain": lambda: [words["gain"] - 1.0],
    }  # fmt: skip
    plain = effect.name not in special or names == list(spoken)
    values = [words[name] for name in names] if plain else special[effect.name]()
    return np.array(values, dtype=float)


def _waves(effect: Effect, words: Mapping[str, float]) -> list[float]:
    """The waves of cogging about the middle of the recorded range."""
    assert isinstance(effect, Cogging)
    ends = ENDINGS[: effect.linear // 2]
    angles = [words[f"phase{end}"] + words[f"periods{end}"] * effect.center for end in ends]
    parts = [words[f"amplitude{end}"] * np.exp(1j * angle) for end, angle in zip(ends, angles, strict=True)]
    return [*(x for part in parts for x in (part.real, part.imag)), *(words[f"periods{end}"] for end in ends)]


def forms_of(name: str, target: str, words: Mapping[str, float], effects: Sequence[Effect]) -> list[Form]:
    """All ways in which effects of a catalogue can hold something that was named with its parameters."""
    alike = [effect for effect in effects if effect.key == (name, target)]
    if name in _VECTORS:
        size = max(map(abs, words.values()))
        axes = [{axis: value} for axis, value in words.items() if abs(value) > 1e-6 * size]
        return [[(effect, found) for part in axes for effect, found in _holding(alike, part)]]
    return [[pair] for pair in _holding(alike, words)]


def _holding(effects: Sequence[Effect], words: Mapping[str, float]) -> Form:
    found = [(form, values_of(form, words)) for effect in effects for form in effect.family()]
    return [(effect, values) for effect, values in found if values is not None]


def true_forms(
    truth: Mapping[str, Any], key: Mapping[str, Any], effects: Sequence[Effect], model: mujoco.MjModel
) -> list[Form]:
    """All ways in which the package can hold a true effect, with its true parameters."""
    name, target = truth["name"], truth["target"]
    words = described(truth)
    forms = forms_of(name, target, words, effects)
    if key["loop"] == "servo" and name == "actuator_saturation":
        return [form for form in forms if form[0][0].variant == "force"]
    if name == "joint_stop":
        high = max(bound[1] for bound in truth["region"].values())
        return [form for form in forms if form[0][0].variant == ("upper" if high == np.inf else "lower")]
    if name == "payload_mass":
        body = model.body(target.partition(":")[2]).id
        far = PayloadMass.at(Place(target, body), model, model.body_ipos[body].copy(), "far")
        return [*(form for form in forms if form[0][0].variant == "center"), [(far, np.array([words["mass"]]))]]
    return forms


def sets_of(forms: Sequence[Sequence[Form]]) -> list[tuple[list[Effect], list[Array]]]:
    """Every combination of the forms of several effects, values within their bounds."""
    sets = []
    for choice in itertools.product(*forms):
        pairs = [pair for form in choice for pair in form]
        sets.append(([effect for effect, _ in pairs], [_bounded(effect, values) for effect, values in pairs]))
    return sets


def _bounded(effect: Effect, values: Array) -> Array:
    low, high = ([getattr(parameter, end) for parameter in effect.parameters] for end in ("low", "high"))
    return np.clip(values, low, high)
