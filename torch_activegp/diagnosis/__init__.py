"""Why a simulator and recordings differ.

:func:`diagnose` is the whole way, in the order of its packages: ``inputs`` (model and recordings, checked, cut into
segments), ``noise`` (from the recordings alone), ``simulation`` (the model with effects in it, many side by side),
``shooting`` (the likelihood and its fits), ``preparation`` (numerics and length of segments), ``selection`` (which set
of effects) and ``findings`` (what is said of it). Each knows only those before it.
"""

from torch_activegp.diagnosis.checkpoint import Checkpoint
from torch_activegp.diagnosis.diagnose import diagnose
from torch_activegp.diagnosis.evaluate import evaluate
from torch_activegp.diagnosis.result import Diagnosis, Estimate, NamedEffect
from torch_activegp.diagnosis.simulation.blackbox_simulator import AcceleratedSimulator
from torch_activegp.diagnosis.simulation.saved import load_corrected
from torch_activegp.diagnosis.simulation.simulator import EffectSimulator

__all__ = [
    "AcceleratedSimulator",
    "Checkpoint",
    "Diagnosis",
    "EffectSimulator",
    "Estimate",
    "NamedEffect",
    "diagnose",
    "evaluate",
    "load_corrected",
]
