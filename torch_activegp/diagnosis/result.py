"""What a diagnosis says, as values."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

SCHEMA_VERSION = 1


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A parameter.

    Args:
        value: the estimate.
        unit: SI unit.
        ci95: interval that holds the true value in 95 of 100 cases.
    """

    value: float
    unit: str
    ci95: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.ci95
        return f"{self.value:.4g} {self.unit} [{low:.4g}, {high:.4g}]"


@dataclasses.dataclass(frozen=True)
class NamedEffect:
    """Physics that the simulator leaves out.

    Args:
        name: the field's name.
        target: where it acts.
        law: the law in one line.
        share: part of the mismatch that it explains, 0 to 1.
        probability: how probable it is among the sets that were compared.
        parameters: by name.
        ties: other (name, target) pairs that the recordings cannot tell from it.
        mjcf: whether ``corrected.xml`` holds it; None where the simulator is none in MJCF.
    """

    name: str
    target: str
    law: str
    share: float
    probability: float
    parameters: Mapping[str, Estimate]
    ties: tuple[tuple[str, str], ...] = ()
    mjcf: bool | None = False

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``diagnosis.json``."""
        return {
            "name": self.name,
            "target": self.target,
            "share": self.share,
            "probability": self.probability,
            "parameters": {
                k: {"value": e.value, "unit": e.unit, "ci95": list(e.ci95)} for k, e in self.parameters.items()
            },
            "ties": [{"name": name, "target": target} for name, target in self.ties],
            "law": self.law,
            "mjcf": self.mjcf,
        }


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The result of :func:`~torch_activegp.diagnosis.diagnose`.

    Args:
        verdict: ``none``, ``named``, ``tie`` or ``unknown``.
        sentence: the verdict in words.
        effects: in the order in which they explain.
        details: the other entries of ``diagnosis.json``.
        evidence: what the report draws.
        files: further files to write, text by name: ``corrected.xml``, ``next.csv``, ...
        corrected: the simulator with the effects in it; see
            :func:`~torch_activegp.diagnosis.simulator.corrected_simulator`.
        learned: the same with a Gaussian process of the force that no effect explains, or None where there is none.
        states: further files to write with ``torch.save``, by name: ``remainder.pt``.
    """

    verdict: str
    sentence: str
    effects: tuple[NamedEffect, ...]
    details: Mapping[str, Any]
    evidence: Mapping[str, Any]
    files: Mapping[str, str]
    corrected: Any = None
    learned: Any = None
    states: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __str__(self) -> str:
        lines = [self.sentence]
        for effect in self.effects:
            values = ", ".join(f"{name} {estimate}" for name, estimate in effect.parameters.items())
            ties = "".join(f"; or {name} at {target}" for name, target in effect.ties)
            lines.append(f"  {effect.name} at {effect.target}: {values}; explains {effect.share:.0%}{ties}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """What ``diagnosis.json`` holds."""
        return {
            "schema_version": SCHEMA_VERSION,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "effects": [effect.to_dict() for effect in self.effects],
            **self.details,
        }

    def save(self, folder: Path | str) -> None:
        """Writes ``diagnosis.json``, ``evidence.json`` and the corrected model, each whole or not at all."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        texts = dict(self.files)
        texts["evidence.json"] = json.dumps(self.evidence)
        texts["diagnosis.json"] = json.dumps(self.to_dict(), indent=1)
        for name, text in texts.items():
            write_whole(folder / name, text)
        for name, state in self.states.items():
            temporary = folder / f".{name}.tmp"
            torch.save(state, temporary)
            os.replace(temporary, folder / name)


def write_whole(path: Path, text: str) -> None:
    """Writes a file under a temporary name and renames it, so that an interruption leaves the old one."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
