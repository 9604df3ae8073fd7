"""Mean functions: the simulator, and the previous episode's posterior."""

from torch_activegp.means.episodic_mean import EpisodicMean
from torch_activegp.means.kernel_expansion import KernelExpansion
from torch_activegp.means.layout import predict_mean
from torch_activegp.means.simulator_mean import SimulatorMean

__all__ = ["EpisodicMean", "KernelExpansion", "SimulatorMean", "predict_mean"]
