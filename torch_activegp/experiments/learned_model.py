"""A learned model on disk: written once, loaded again as a simulator."""

from __future__ import annotations

from pathlib import Path

import torch

from torch_activegp.errors import CheckpointError
from torch_activegp.experiments.learn import Learned, build_gp
from torch_activegp.experiments.nominal import nominal_simulator
from torch_activegp.loops.checkpoint import load_checkpoint, save_checkpoint
from torch_activegp.models import LearnedSimulator
from torch_activegp.simulators import Simulator

_SETTINGS = {"kind": "learned simulator"}
_PROBES = 16


def save_learned(path: Path, outcome: Learned) -> None:
    """Write what :func:`load_learned` needs: the simulator's name, its time step, and the state of the GP.

    Args:
        path: file to write, ``.pt``.
        outcome: from :func:`~torch_activegp.experiments.learn.learn`.

    Raises:
        CheckpointError: the file cannot be written.
    """
    gp = outcome.learned.gp
    model = Path(outcome.model).resolve() if Path(outcome.model).is_file() else outcome.model
    content = {
        "model": str(model),
        "dt": outcome.simulator.dt,
        "external_force": outcome.external_force,
        "state_dict": outcome.learned.state_dict(),
        "probe": _predict(outcome.simulator, gp.inputs[:_PROBES]),
    }
    save_checkpoint(path, _SETTINGS, content)


def load_learned(path: str | Path, model: str | None = None) -> LearnedSimulator:
    """Load a learned model as a :class:`~torch_activegp.simulators.Simulator`.

    Args:
        path: the file that :func:`save_learned` wrote.
        model: the simulator that was the mean, where it is no longer where it was: an MJCF file,
            ``package.module:factory`` or ``emps``.

    Returns:
        Simulator + GP; :class:`~torch_activegp.means.SimulatorMean` takes it as the mean of the next GP.

    Raises:
        CheckpointError: the file is missing, damaged, or no learned model, or the simulator is another by now.
        ConfigurationError: there is no such simulator.
    """
    content = load_checkpoint(Path(path), _SETTINGS)
    name = model or content["model"]
    simulator = nominal_simulator(name, content["dt"], external_force=content["external_force"])
    state = content["state_dict"]
    inputs = state["gp.inputs"]
    wanted = (simulator.state_dim + simulator.action_dim, simulator.state_dim)
    if wanted != (inputs.shape[-1], state["trust"].shape[-1]):
        raise CheckpointError(
            f"{path}: `{name}` has {wanted[1]} states and {wanted[0] - wanted[1]} actions, not those that were learned "
            "with. Name the simulator that was learned with."
        )
    gp = build_gp(simulator, inputs.amin(0), inputs.amax(0))
    learned = LearnedSimulator(gp, simulator.action_space, simulator.dt)
    learned.load_state_dict(state)
    if not torch.allclose(_predict(simulator, inputs[:_PROBES]), content["probe"], rtol=1e-6, atol=1e-9):
        raise CheckpointError(
            f"{path}: `{name}` predicts something else than when it was learned with, so it has changed. Name the "
            "simulator that was learned with, or learn again."
        )
    return learned


@torch.no_grad()
def _predict(simulator: Simulator, inputs: torch.Tensor) -> torch.Tensor:
    states, actions = inputs.split([simulator.state_dim, simulator.action_dim], dim=-1)
    return simulator.step(states, actions)
