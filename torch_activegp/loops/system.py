"""What a loop must know of the real system: the bounds of its actions and its time step."""

from __future__ import annotations

from torchrl.data import Bounded
from torchrl.envs import EnvBase

from torch_activegp.errors import ConfigurationError
from torch_activegp.means import EpisodicMean
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import ActionSpace, Simulator


def action_space_of(env: EnvBase) -> ActionSpace:
    """The bounds of an environment's actions.

    Raises:
        ConfigurationError: the actions have no bounds.
    """
    simulator = getattr(env, "simulator", None)
    if isinstance(simulator, Simulator):
        return simulator.action_space
    spec = env.action_spec
    if not isinstance(spec, Bounded):
        raise ConfigurationError(f"Wanted bounded actions of {type(env).__name__}, found {type(spec).__name__}.")
    names = [f"action {j}" for j in range(spec.shape[-1])]
    return ActionSpace(names, spec.space.low.double(), spec.space.high.double())


def time_step_of(env: EnvBase, gp: DynamicsGP) -> float:
    """The time between two states, s: the environment's ``dt``, else that of the simulator in the GP's mean.

    Raises:
        ConfigurationError: neither has one.
    """
    mean = gp.mean_module.base_mean if isinstance(gp.mean_module, EpisodicMean) else gp.mean_module
    for owner in (env, getattr(mean, "simulator", None)):
        dt = getattr(owner, "dt", None)
        if dt is not None:
            return float(dt)
    raise ConfigurationError(
        f"The time step is unknown: neither {type(env).__name__} nor the GP's mean has `dt`. Set env.dt, in seconds."
    )
