"""A corrected simulator in a file, where MJCF cannot hold it."""

from __future__ import annotations

import dataclasses
import io
import pickle
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from torch_activegp.diagnosis.checkpoint import Unpickler
from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.simulation.blackbox_simulator import AcceleratedSimulator
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.simulator import EffectSimulator
from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.physics.effect import Effect
from torch_activegp.simulators import Simulator

_HEADER = b"torch_activegp corrected simulator 2\n"
_OURS = "torch_activegp."
_PROTOCOL = 4
_UNFIT = (pickle.PickleError, EOFError, AttributeError, ImportError, IndexError, TypeError, ValueError)


@dataclasses.dataclass(frozen=True)
class _Saved:
    """What a file holds.

    Args:
        model: the nominal model as MuJoCo writes it; None for a nominal that is no MuJoCo model.
        channels: the joints that effects with a memory follow.
        candidate: effects and their values.
        dt: time between two states, s.
        substeps: time steps in it.
        integrator: of them; None for the model's own.
    """

    model: bytes | None
    channels: Channels
    candidate: Candidate
    dt: float
    substeps: int
    integrator: int | None


def saved(simulator: EffectSimulator) -> bytes:
    """A simulator with effects as the content of a file, which :func:`load_corrected` reads.

    Raises:
        ConfigurationError: an effect is of a class that no module holds.
    """
    accelerated = isinstance(simulator, AcceleratedSimulator)
    content = _Saved(
        None if accelerated else _bytes(simulator.model),
        simulator.channels,
        simulator.candidate,
        simulator.dt,
        simulator.substeps,
        simulator.integrator,
    )
    try:
        return _HEADER + pickle.dumps(content, protocol=_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ConfigurationError(f"{error}. Define the class of an effect at the top of a module.") from error


def saved_files(simulators: Mapping[str, Simulator | None], notes: list[str]) -> dict[str, str | bytes]:
    """Contents of files, by name, for those simulators that MJCF cannot hold; notes on those that no file can."""
    files: dict[str, str | bytes] = {}
    for name, simulator in simulators.items():
        if isinstance(simulator, EffectSimulator):
            try:
                files[name] = saved(simulator)
            except ConfigurationError as error:
                notes.append(f"{name} is not written: {error}")
    return files


def load_corrected(
    path: Path | str, *, nominal: Simulator | None = None, effects: Sequence[type[Effect]] = ()
) -> EffectSimulator:
    """Reads a simulator with effects that a diagnosis saved (``corrected.pt``, ``learned.pt``).

    Nothing but arrays and the classes of this package are taken from the file, whoever wrote it.

    Args:
        path: of the file.
        nominal: the nominal simulator, where that is not MuJoCo's: the file has only what comes on top of it.
        effects: classes of your own that were tried in the diagnosis.

    Raises:
        DataError: there is no such file, it was not written by a diagnosis, or it asks for a class that is not known.
        ConfigurationError: the nominal simulator is missing.

    Example:
        >>> # mean = SimulatorMean(load_corrected("out/corrected.pt"))
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: no such file. A diagnosis writes corrected.pt where MJCF cannot hold the effects.")
    header, content = path.read_bytes()[: len(_HEADER)], path.read_bytes()[len(_HEADER) :]
    if header != _HEADER:
        raise DataError(f"{path}: corrected.pt or learned.pt of a diagnosis wanted, found another kind of file.")
    try:
        found = Unpickler(io.BytesIO(content), ours=_OURS, known=effects).load()
        if not isinstance(found, _Saved):
            raise pickle.UnpicklingError(f"a simulator wanted, found a {type(found).__name__}")
    except _UNFIT as error:
        raise DataError(
            f"{path} cannot be read: {error}. If the diagnosis tried classes of your own, pass them in `effects`."
        ) from error
    if found.model is not None:
        model = mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": found.model})
        parts = model, found.channels, found.candidate
        return EffectSimulator(*parts, dt=found.dt, substeps=found.substeps, integrator=found.integrator)
    if nominal is None:
        raise ConfigurationError(
            f"{path} holds what comes on top of a simulator that is not MuJoCo's. Pass that in `nominal`."
        )
    return AcceleratedSimulator(BlackBox.of(nominal), found.channels, found.candidate)


def _bytes(model: mujoco.MjModel) -> bytes:
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()
