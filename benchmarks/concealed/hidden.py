"""An effect before its size is known, and the scales of the machine that it is drawn for."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.concealed.plant import J, Plant, copy

Region = dict[str, tuple[float, float]]
Parameters = dict[str, tuple[float, str]]


@dataclasses.dataclass(frozen=True)
class Typical:
    """What the machine does without the effect, for scales.

    Args:
        torque, speed, reach: (n,), rms of joint force and speed, half the range of positions.
        low, high: (n,), 2 % and 98 % quantiles of the positions.
        control, most: (m,), rms and 99.5 % quantile of |control|; for a servo, of its force.
        inertia: (n,), diagonal of the mass matrix with rotors.
        mass, com: (n,) and (n, 3), of each body, in its own frame.
        names: `joints`, `actuators`, `bodies`, `slides`, `servo` of the model.
    """

    torque: np.ndarray
    speed: np.ndarray
    reach: np.ndarray
    low: np.ndarray
    high: np.ndarray
    control: np.ndarray
    most: np.ndarray
    inertia: np.ndarray
    mass: np.ndarray
    com: np.ndarray
    joints: tuple[str, ...]
    actuators: tuple[str, ...]
    bodies: tuple[str, ...]
    slides: tuple[bool, ...]
    servo: bool


@dataclasses.dataclass(frozen=True)
class Hidden:
    """An effect with a free amplitude: ``change(plant, s)`` edits a copy; ``parameters(s)`` for the key."""

    name: str
    target: str
    change: Callable[[Plant, float], None]
    parameters: Callable[[float], Parameters]
    most: float = 1.5
    region: Callable[[float], Region] | None = None

    def on(self, plant: Plant, s: float) -> Plant:
        """The plant with the effect."""
        changed = copy(plant)
        self.change(changed, s)
        return changed


def columns(row: int, values: Callable[[float], Mapping[int, float]]) -> Callable[[Plant, float], None]:
    """An edit of the joints' table: coefficients are added, other columns are set."""
    added = (J.VISCOUS, J.DRY_FORTH, J.DRY_BACK, J.CONSTANT, J.ROTOR)

    def change(plant: Plant, s: float) -> None:
        for column, value in values(s).items():
            plant.joint[row, column] = value + (plant.joint[row, column] if column in added else 0.0)

    return change


def setting(table: str, row: int, column: int, value: Callable[[float], float]) -> Callable[[Plant, float], None]:
    def change(plant: Plant, s: float) -> None:
        getattr(plant, table)[row, column] = value(s)

    return change


def units(slide: bool) -> tuple[str, str]:
    return ("N", "m") if slide else ("N m", "rad")
