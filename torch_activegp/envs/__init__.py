"""Environments: the GP to plan in, and real systems whose state can be set."""

from torch_activegp.envs.gp_env import GPEnv
from torch_activegp.envs.gym import MujocoGymEnv
from torch_activegp.envs.simulator_env import SimulatorEnv
from torch_activegp.envs.transitions import MeanTransition, OptimisticTransition, Transition

__all__ = ["GPEnv", "MeanTransition", "MujocoGymEnv", "OptimisticTransition", "SimulatorEnv", "Transition"]
