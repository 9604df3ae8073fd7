"""The nominal model, from whatever a user has."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import MujocoSimulator, Simulator
from torch_activegp.simulators.mujoco_model import load_model


@dataclasses.dataclass(frozen=True)
class Source:
    """A nominal model.

    Args:
        model: compiled; what stands for it where the simulator is not MuJoCo.
        spec: to edit, or None where there is nothing to edit.
        name: for people.
        path: of its file, or what else it was.
        frame_skip: time steps for each action, where it came as a simulator.
        box: the simulator, where it is not MuJoCo.
    """

    model: mujoco.MjModel
    spec: mujoco.MjSpec | None
    name: str
    path: str
    frame_skip: int = 1
    box: BlackBox | None = None


def read_source(model: object) -> Source:
    """Reads a model.

    Args:
        model: path of an MJCF file, MJCF text, an ``MjSpec``, an ``MjModel``, a `MujocoSimulator`, or any other
            `Simulator` whose state is positions and their velocities.

    Raises:
        ConfigurationError: no such file, it does not compile, its state is another, or it is something else.
        SimulationError: a simulator fails, or returns something else than next states.
    """
    if isinstance(model, MujocoSimulator):
        return dataclasses.replace(read_source(model.model), frame_skip=model.frame_skip)
    if isinstance(model, Simulator):
        box = BlackBox.of(model)
        return Source(box.model, None, box.name, f"a {box.name}", box=box)
    if isinstance(model, mujoco.MjModel):
        return Source(load_model(model), _decompiled(model), "MjModel", "an MjModel")
    if isinstance(model, mujoco.MjSpec):
        return Source(load_model(model), model.copy(), model.modelname or "MjSpec", "an MjSpec")
    if not isinstance(model, str | Path):
        raise ConfigurationError(
            "diagnose: an MJCF file, an MjSpec, an MjModel or a Simulator wanted, found a "
            f"{type(model).__name__}. Wrap a function (state, action) -> next state in FunctionSimulator."
        )
    compiled = load_model(model)
    if isinstance(model, str) and model.lstrip().startswith("<"):
        return Source(compiled, mujoco.MjSpec.from_string(model), "MJCF text", "MJCF text")
    spec = mujoco.MjSpec.from_file(str(model))
    _root_assets(spec, Path(model).resolve().parent)
    return Source(compiled, spec, Path(model).name, str(model))


def _root_assets(spec: mujoco.MjSpec, folder: Path) -> None:
    """Lets the model find its meshes and pictures wherever its text is written to."""
    if any(asset.file for asset in (*spec.meshes, *spec.hfields, *spec.skins)):
        spec.meshdir = str(folder / spec.meshdir)
    if any(texture.file or any(texture.cubefiles) for texture in spec.textures):
        spec.texturedir = str(folder / spec.texturedir)


def _decompiled(model: mujoco.MjModel) -> mujoco.MjSpec:
    """MuJoCo keeps the last XML that this process loaded, so a model goes back to MJCF only if it is of that one."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "model.xml"
            mujoco.mj_saveLastXML(str(file), model)
            spec = mujoco.MjSpec.from_file(str(file))
        again = spec.copy().compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(_GIVE_FILE) from error
    alike = ("body_mass", "body_pos", "jnt_axis", "dof_damping", "actuator_gainprm")
    same = again.names == model.names and all(
        np.allclose(getattr(again, name), getattr(model, name), rtol=1e-4, atol=1e-9) for name in alike
    )
    if not same:
        raise ConfigurationError(_GIVE_FILE)
    return spec


_GIVE_FILE = (
    "diagnose: this MjModel cannot be turned back into MJCF; give the file or the MjSpec that it was made from."
)
