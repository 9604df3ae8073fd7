"""Why a simulator and recordings differ."""

from torch_activegp.diagnosis.blackbox_simulator import AcceleratedSimulator
from torch_activegp.diagnosis.checkpoint import Checkpoint
from torch_activegp.diagnosis.diagnose import diagnose
from torch_activegp.diagnosis.evaluate import evaluate
from torch_activegp.diagnosis.result import Diagnosis, Estimate, NamedEffect
from torch_activegp.diagnosis.simulator import EffectSimulator

__all__ = [
    "AcceleratedSimulator",
    "Checkpoint",
    "Diagnosis",
    "EffectSimulator",
    "Estimate",
    "NamedEffect",
    "diagnose",
    "evaluate",
]
