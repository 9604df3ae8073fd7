"""Simulators: one batched protocol for torch equations, torch functions and MuJoCo models."""

from torch_activegp.simulators.base import Simulator
from torch_activegp.simulators.function import FunctionSimulator
from torch_activegp.simulators.integrators import rk4, semi_implicit_euler
from torch_activegp.simulators.load import load_simulator
from torch_activegp.simulators.local_torques import JointStop, LocalBrake, Magnet
from torch_activegp.simulators.mujoco import MujocoSimulator
from torch_activegp.simulators.ode import OdeSimulator
from torch_activegp.simulators.pendulum import Pendulum
from torch_activegp.simulators.space import ActionSpace, StateSpace, wrap_angle

__all__ = [
    "ActionSpace",
    "FunctionSimulator",
    "JointStop",
    "LocalBrake",
    "Magnet",
    "MujocoSimulator",
    "OdeSimulator",
    "Pendulum",
    "Simulator",
    "StateSpace",
    "load_simulator",
    "rk4",
    "semi_implicit_euler",
    "wrap_angle",
]
