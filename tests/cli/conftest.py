"""Fixtures for the tests of the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from torch_activegp.cli import app

MACHINES = """
import torch
from torch_activegp.experiments import PRINTED, Task
from torch_activegp.simulators import ActionSpace, FunctionSimulator, Simulator, StateSpace

states, actions = StateSpace(["x", "v"], -1.0, 1.0), ActionSpace(["u"], -1.0, 1.0)

def cart(gain):
    def step(state, action):
        return torch.cat([state[..., :1] + 0.1 * state[..., 1:], state[..., 1:] + gain * action], dim=-1)
    return FunctionSimulator(step, states, actions, dt=0.1)

def make(step, states=states, actions=actions):
    return FunctionSimulator(step, states, actions, dt=0.1)

def real(): return cart(0.1)
def wrong(): return cart(0.05)
def whole(): return Task("cart", cart(0.1), cart(0.05), PRINTED, grid=5)
def number(): return 3
def fails(): raise KeyError("the key to the lab")
def nan(): return make(lambda s, a: torch.where(s[..., :1] > 0.9, torch.nan, s + 0 * a))
def unbounded(): return make(lambda s, a: s + 0 * a, 2, actions)
def renamed(): return make(lambda s, a: s + 0 * a, StateSpace(["x", "w"], -1.0, 1.0))

class Odd(Simulator):
    def step(self, state, action): return state[..., :1]

def odd(): return Odd(states, actions, 0.1)
"""
SLIDE = """
<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0" {loss}/><geom size=".1" mass="1"/></body></worldbody>
<actuator><motor name="push" joint="slide"/></actuator></mujoco>"""
ROD = """
<mujoco>
  <worldbody>
    <body><joint name='hip' axis='0 1 0'/><geom size='.05' fromto='0 0 0 0 0 -1' type='capsule'/></body>
  </worldbody>
  <actuator><motor joint='hip' name='m' ctrlrange='-2 2' gear='{gear}'/></actuator>
</mujoco>
"""


@pytest.fixture
def slide() -> Callable[..., str]:
    """The MJCF text of a slide, with losses as attributes of its joint."""
    return SLIDE.format


@pytest.fixture
def record_slide() -> Callable[[str, int, int], pd.DataFrame]:
    """Recordings of a slide: positions alone, with noise."""

    def record(xml: str, seed: int, rows: int) -> pd.DataFrame:
        model, random = mujoco.MjModel.from_xml_string(xml), np.random.default_rng(seed)
        data, time = mujoco.MjData(model), np.arange(rows) * 0.01
        rate, phase = random.uniform(1.0, 9.0, (2, 4, 1))
        control = 1.5 * np.sin(rate * time + phase).sum(0)
        position = np.empty_like(time)
        for row, force in enumerate(control):
            position[row], data.ctrl[0] = data.qpos[0], force
            mujoco.mj_step(model, data, 2)
        position += 1e-4 * random.standard_normal(len(time))
        return pd.DataFrame({"time": time, "qpos.slide": position, "ctrl.push": control})

    return record


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working folder of a user: a module ``machines`` with simulators, and two MJCF files."""
    (tmp_path / "machines.py").write_text(MACHINES)
    (tmp_path / "rod.xml").write_text(ROD.format(gear=20))
    (tmp_path / "weak_rod.xml").write_text(ROD.format(gear=10))
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("machines", None)


@pytest.fixture
def run(folder: Path) -> Callable[..., Result]:
    """Calls the command line in the user's working folder."""

    def call(*words: str) -> Result:
        result = CliRunner().invoke(app, list(words))
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return call
