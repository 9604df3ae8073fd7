"""A slide and a pendulum with dry friction, recorded by MuJoCo itself, and their models without friction."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording

SLIDE = """
<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0" {loss}/><geom size=".1" mass="1"/></body></worldbody>
<actuator><motor name="push" joint="slide"/></actuator></mujoco>"""
# The rod stands at 0 and hangs at pi, so it swings across the seam of its angle.
ROD = """
<mujoco><option timestep="0.005"/><worldbody><body><joint name="hip" axis="0 1 0" {loss}/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 .5" mass="1"/></body></worldbody>
<actuator><motor name="drive" joint="hip"/></actuator></mujoco>"""
LOSS = {SLIDE: "damping='1' frictionloss='0.5'", ROD: "damping='0.1' frictionloss='0.2'"}
START = {SLIDE: 0.0, ROD: np.pi}
GAIN = {SLIDE: 1.5, ROD: 0.4}


def record(xml: str, name: str, *, seconds: float = 8.0, seed: int = 0, loss: str | None = None) -> Recording:
    """One run of the true machine, 200 Hz, positions with noise of 1e-4, controls that are sums of sines."""
    model = mujoco.MjModel.from_xml_string(xml.format(loss=LOSS[xml] if loss is None else loss))
    data, chance = mujoco.MjData(model), np.random.default_rng(seed)
    data.qpos[0] = START[xml]
    time = np.arange(int(seconds / model.opt.timestep)) * model.opt.timestep
    rate, phase = chance.uniform(1.0, 9.0, (4, 1)), chance.uniform(0.0, 6.0, (4, 1))
    control = GAIN[xml] * np.sin(rate * time + phase).sum(0)
    position = np.empty_like(time)
    for row, force in enumerate(control):
        position[row], data.ctrl[0] = data.qpos[0], force
        mujoco.mj_step(model, data)
    position += 1e-4 * chance.normal(size=len(time))
    if xml is ROD:
        position = np.mod(position + np.pi, 2 * np.pi) - np.pi
    columns = {"time": time, f"qpos.{model.joint(0).name}": position, f"ctrl.{model.actuator(0).name}": control}
    return Recording.from_columns(name, columns)


@pytest.fixture
def slide(tmp_path: Path) -> str:
    """The file of a slide without friction."""
    path = tmp_path / "slide.xml"
    path.write_text(SLIDE.format(loss=""))
    return str(path)


@pytest.fixture
def rod(tmp_path: Path) -> str:
    """The file of a rod without friction."""
    path = tmp_path / "rod.xml"
    path.write_text(ROD.format(loss=""))
    return str(path)


@pytest.fixture(scope="session")
def slide_run() -> Callable[..., Recording]:
    """Records the slide."""
    return lambda name="run", **options: record(SLIDE, name, **options)


@pytest.fixture(scope="session")
def rod_run() -> Callable[..., Recording]:
    """Records the rod."""
    return lambda name="run", **options: record(ROD, name, **options)


@pytest.fixture
def alive() -> Callable[[int], bool]:
    """Whether a process of that number lives."""

    def lives(pid: int) -> bool:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        return True

    return lives
