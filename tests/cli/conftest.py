"""Fixtures for the tests of the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

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
ROD = """
<mujoco>
  <worldbody>
    <body><joint name='hip' axis='0 1 0'/><geom size='.05' fromto='0 0 0 0 0 -1' type='capsule'/></body>
  </worldbody>
  <actuator><motor joint='hip' name='m' ctrlrange='-2 2' gear='{gear}'/></actuator>
</mujoco>
"""


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
