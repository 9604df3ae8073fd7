"""Corrected simulators in files: the same after reading, and nothing else is taken from a file."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np
import pytest
import torch

from torch_activegp.diagnosis import AcceleratedSimulator, EffectSimulator, load_corrected
from torch_activegp.diagnosis.inputs.blackbox import BlackBox, accelerations
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.diagnosis.simulation.saved import saved
from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.physics import Parameter, Place
from torch_activegp.physics.joint import JointEffect

STATES = torch.tensor([[0.3, 1.5], [-0.4, -2.0]], dtype=torch.float64)
ACTIONS = torch.tensor([[[0.7], [0.1]], [[-0.2], [0.0]]], dtype=torch.float64)


def written(folder: Path, simulator: EffectSimulator) -> Path:
    path = folder / "corrected.pt"
    path.write_bytes(saved(simulator))
    return path


@pytest.mark.parametrize("name", ["asymmetric_friction", "actuator_delay", "backlash", "hysteresis", "cogging"])
def test_what_is_read_moves_like_what_was_saved(bench: Any, model: mujoco.MjModel, tmp_path: Path, name: str) -> None:
    effect = next(e for e in bench.effects if e.name == name)
    candidate = Candidate((effect,), (0.5 * effect.seeds[0],))
    simulator = EffectSimulator(model, bench.machine.channels, candidate, dt=0.01, substeps=2)
    again = load_corrected(written(tmp_path, simulator))
    assert type(again) is EffectSimulator
    assert torch.equal(again.rollout(STATES, ACTIONS), simulator.rollout(STATES, ACTIONS))


def test_of_another_simulator_only_what_comes_on_top_is_saved(black: Any, tmp_path: Path) -> None:
    nominal, recordings = black.simulator(), [black.record("none", 0)]
    box = BlackBox.of(nominal)
    machine = make_machine(box.model, recordings, recordings, box)
    effects = accelerations(effects_for(box.model, machine.channels, machine.fit))
    drag = next(effect for effect in effects if effect.name == "quadratic_drag")
    simulator = AcceleratedSimulator(box, machine.channels, Candidate((drag,), (np.array([0.2]),)))
    path = written(tmp_path, simulator)
    with pytest.raises(ConfigurationError, match="a simulator that is not MuJoCo's. Pass that in `nominal`"):
        load_corrected(path)
    again = load_corrected(path, nominal=nominal)
    assert torch.equal(again.rollout(STATES, ACTIONS), simulator.rollout(STATES, ACTIONS))


class Brake(JointEffect):
    """A law of the user's."""

    name = "brake"
    law = "-b v"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        return cls.make(place, (Parameter("level", "N m s/rad", 0.1),), [[0.1]], linear=1)

    def force(self, position: np.ndarray, velocity: np.ndarray, values: np.ndarray) -> np.ndarray:
        return -values[0] * velocity


def test_a_class_of_the_users_is_read_where_it_is_passed(bench: Any, model: mujoco.MjModel, tmp_path: Path) -> None:
    brake = Brake.at(Place("joint:hip", 0), model)
    candidate = Candidate((brake,), (np.array([0.3]),))
    simulator = EffectSimulator(model, bench.machine.channels, candidate, dt=0.01, substeps=2)
    path = written(tmp_path, simulator)
    with pytest.raises(DataError, match=r"Brake` does not belong there.*pass them in `effects`"):
        load_corrected(path)
    assert torch.equal(load_corrected(path, effects=[Brake])(STATES, ACTIONS[:, 0]), simulator(STATES, ACTIONS[:, 0]))


class _Asks:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("made",)


def test_a_file_that_asks_for_more_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    header = saved.__globals__["_HEADER"]
    for content in (header + pickle.dumps(_Asks()), header + b"garbage", header, header + pickle.dumps({"a": 1})):
        Path("corrected.pt").write_bytes(content)
        with pytest.raises(DataError, match="corrected.pt cannot be read"):
            load_corrected("corrected.pt")
    Path("corrected.pt").write_bytes(pickle.dumps(_Asks()))
    with pytest.raises(DataError, match="corrected.pt or learned.pt of a diagnosis wanted, found another kind"):
        load_corrected("corrected.pt")
    with pytest.raises(DataError, match="other.pt: no such file"):
        load_corrected("other.pt")
    assert not Path("made").exists()
