from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis import Checkpoint, diagnose
from torch_activegp.diagnosis.selection.repeated import repeated

ROTOR = """<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body>
<joint name="shaft" axis="0 0 1" damping="0.02"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body>
</worldbody><actuator><motor name="coil" joint="shaft"/></actuator></mujoco>"""


def turned(seed: int, waves: list[tuple[float, float, float]], middle: float = 0.0) -> dict[str, np.ndarray]:
    """Columns of a run: J a = u - c v + sum A sin(N q + phase), by Runge-Kutta, with white noise on the angle."""
    rng = np.random.default_rng(seed)
    time = np.arange(301) / 100
    control = 0.12 * np.sin(2 * np.pi * rng.uniform(0.4, 1.4) * time + rng.uniform(0, 6)) + 0.06 * np.sin(9.0 * time)

    def slope(x: np.ndarray, u: float) -> np.ndarray:
        force = sum(size * np.sin(count * x[0] + phase) for size, count, phase in waves)
        return np.array([x[1], (u - 0.02 * x[1] + force) / 0.01])

    x, angles, h = np.array([middle, 0.0]), [], 1 / 500
    for u in control:
        angles.append(x[0])
        for _ in range(5):
            a = slope(x, u)
            b = slope(x + h / 2 * a, u)
            c = slope(x + h / 2 * b, u)
            x = x + h / 6 * (a + 2 * b + 2 * c + slope(x + h * c, u))
    return {"time": time, "qpos.shaft": np.array(angles) + 2e-4 * rng.normal(size=301), "ctrl.coil": control}


@pytest.mark.parametrize(("periods", "middle"), [(14.0, 0.0), (20.0, 0.0), (28.0, 0.0), (30.0, 0.0), (14.0, 30.0)])
def test_one_wave_of_any_number_anywhere_is_one_wave(periods: float, middle: float) -> None:
    waves = [(0.03, periods, 0.3 - periods * middle)]
    runs = [Recording.from_columns(f"run{i}", turned(i, waves, middle)) for i in range(3)]
    found = diagnose(ROTOR, runs, [Recording.from_columns("kept", turned(9, waves, middle))], nthread=1)
    assert [(effect.name, effect.target) for effect in found.effects] == [("cogging", "joint:shaft")]
    law = found.effects[0].parameters
    assert set(law) == {"amplitude", "periods", "phase"}
    assert law["periods"].value == pytest.approx(periods, abs=0.05)
    assert law["amplitude"].value == pytest.approx(0.03, rel=0.03)


def test_magnets_that_pull_in_two_waves_are_one_name_with_both(tmp_path) -> None:
    waves = [(0.03, 8.0, 0.3), (0.025, 21.0, -1.0)]
    runs = [Recording.from_columns(f"run{i}", turned(i, waves)) for i in range(3)]
    checkpoint = Checkpoint(tmp_path / "kept")
    found = diagnose(ROTOR, runs, [Recording.from_columns("kept", turned(9, waves))], nthread=1, checkpoint=checkpoint)
    assert checkpoint.stage == "naming"  # with the form of two waves in it
    assert [(effect.name, effect.target) for effect in found.effects] == [("cogging", "joint:shaft")]
    law = found.effects[0].parameters
    numbers = sorted((law[f"periods{end}"].value, law[f"amplitude{end}"].value) for end in ("", "_2"))
    assert [n for n, _ in numbers] == pytest.approx([8.0, 21.0], abs=0.05)
    assert [size for _, size in numbers] == pytest.approx([0.03, 0.025], rel=0.03)
    assert "periods_3" not in law
    assert (law["amplitude_2"].unit, law["periods_2"].unit, law["phase_2"].unit) == ("N m", "1/turn", "rad")


@dataclasses.dataclass(eq=False)
class Twice:
    """An effect that may act twice."""

    more: Any = None
    key: str = "twice"

    def family(self) -> list[Any]:
        return [self, *(self.more.family() if self.more else [])]


@dataclasses.dataclass(eq=False)
class Gaining:
    effect: Twice
    gain: float
    effects: Any = None


def test_once_more_has_to_be_worth_more() -> None:
    effect, other = Twice(Twice()), Twice()
    first, second, third = (Gaining(effect, gain) for gain in (50.0, 30.0, 10.0))
    screened: Any = dataclasses.make_dataclass("Screened", ["atoms"])([third, second, first, Gaining(other, 99.0)])

    def worth(atoms: Any) -> float:
        return float(sum(atom.gain for atom in atoms))

    nothing, once = Gaining(other, 0.0), Gaining(other, 0.0)
    for fit, held in ((nothing, []), (once, [effect])):
        fit.effects = held
    assert repeated(nothing, screened, worth, 20.0) == [(first, second)]
    assert repeated(nothing, screened, worth, 40.0) == []
    assert repeated(once, screened, worth, 20.0) == []  # there is room for one more, which single proposals bring
