"""How far a displacement of some joints moves others, through the inertia of what they carry."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Dofs = NDArray[np.int64]
_POSES = 60


def coupling(model: mujoco.MjModel, poses: Array, moved: Dofs, given: Dofs) -> Array:
    """Root mean square over poses of the motion of joints that follows from a motion of others, without any force.

    Args:
        model: compiled.
        poses: positions ``(n, nq)``; some of them serve.
        moved: C degrees of freedom.
        given: P others; all that are in neither move freely.

    Returns:
        ``(C, P)``, in rad or m of one for 1 rad or 1 m of the other.
    """
    data = mujoco.MjData(model)
    free = np.setdiff1d(np.arange(model.nv), given)
    rows = np.searchsorted(free, moved)
    inertia, squares = np.zeros((model.nv, model.nv)), []
    for pose in poses[:: max(len(poses) // _POSES, 1)]:
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, inertia)
        squares.append(np.linalg.solve(inertia[np.ix_(free, free)], inertia[np.ix_(free, given)])[rows] ** 2)
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))
