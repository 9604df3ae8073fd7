"""Is ours the machine that MuJoCo reads from the file? Accelerations at random states, without dry friction."""

from __future__ import annotations

import mujoco
import numpy as np

from benchmarks.unseen.machine import Machine
from benchmarks.unseen.machines import MACHINES
from benchmarks.unseen.plant import Friction


def difference(machine: Machine, states: int = 50) -> float:
    """Largest difference of accelerations, relative to the largest acceleration of each state."""
    rng = np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(machine.mjcf())
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    names = [model.joint(i).name for i in range(model.njnt)]
    assert names == [j.name for j in machine.joints], names
    data = mujoco.MjData(model)
    plant = machine.plant()
    plant.friction = Friction.of(np.zeros(len(names)))
    worst = 0.0
    for _ in range(states):
        q, v = rng.normal(size=model.nq), rng.normal(size=model.nv) * 2
        u = np.clip(rng.normal(size=model.nu), -1, 1)
        data.qpos, data.qvel, data.ctrl = q, v, u
        mujoco.mj_forward(model, data)
        M, rhs, _, _ = plant.smooth(np.zeros(1), q[None], v[None], np.zeros((1, 0)), u[None])
        ours = np.linalg.solve(M[0], rhs[0])
        fast, slow = plant.tree.dynamics(q[None], v[None]), plant.tree.slow_dynamics(q[None], v[None])
        assert all(np.allclose(a, b, rtol=1e-10, atol=1e-10) for a, b in zip(fast, slow, strict=True))
        worst = max(worst, float(np.abs(ours - data.qacc).max() / np.abs(data.qacc).max()))
    return worst


def check() -> dict[str, float]:
    """All machines."""
    return {name: difference(machine) for name, machine in MACHINES.items()}
