"""Find out where a simulator is wrong, and learn the rest with a Gaussian process.

The packages, from the ground up: :mod:`~torch_activegp.data` (recordings), :mod:`~torch_activegp.physics` (effects that
simulators leave out), :mod:`~torch_activegp.simulators`, :mod:`~torch_activegp.means`, :mod:`~torch_activegp.models`,
:mod:`~torch_activegp.acquisition`, :mod:`~torch_activegp.envs`, :mod:`~torch_activegp.planners`,
:mod:`~torch_activegp.collectors`, :mod:`~torch_activegp.diagnosis` (why a simulator and recordings differ),
:mod:`~torch_activegp.loops`, :mod:`~torch_activegp.experiments` and :mod:`~torch_activegp.report`.
"""

__version__ = "0.1.0"
