"""What a diagnosis says, as values."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch_activegp.files import written_whole

SCHEMA_VERSION = 1
_OWN = ("diagnosis.json", "evidence.json", "corrected.xml", "corrected.pt", "learned.pt", "next.csv")
"""The files of a diagnosis; which of the last three there are depends on what was found."""


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
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.value:.4g}{unit} [{low:.4g}, {high:.4g}]"


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
        too_much: whether the simulator has too much of it, rather than too little.
    """

    name: str
    target: str
    law: str
    share: float
    probability: float
    parameters: Mapping[str, Estimate]
    ties: tuple[tuple[str, str], ...] = ()
    mjcf: bool | None = False
    too_much: bool = False

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
            "too_much": self.too_much,
        }


@dataclasses.dataclass(frozen=True)
class Spread:
    """How far a parameter moves when recordings are left out.

    Args:
        low: the least estimate.
        high: the largest.
        shift: the largest change from the estimate on all recordings, in standard errors of that as segments tell it.
        farthest: the recording without which it changes most.
    """

    low: float
    high: float
    shift: float
    farthest: str


@dataclasses.dataclass(frozen=True)
class EffectStability:
    """What becomes of one effect when recordings are left out.

    Args:
        name: as in :class:`NamedEffect`.
        target: as there.
        gains: by how much the effect, fitted to the others, lowers the chi2 of each recording that was left out, in
            units of the noise; None where the others say nothing about the effect, or where a simulation fails.
        rests_on: recordings without which the effect would not have been worth its name.
        parameters: by name, over the fits that say something about the effect; empty where there is none.
        fails_without: recordings that can be simulated with the effect, fitted to the others, and not without it.
        fails_with: recordings that can be simulated without it alone.
        refuted: whether it makes the forecasts of recordings left out worse, one of them clearly and all together by
            much of what it gains on the recordings that it was fitted to.
    """

    name: str
    target: str
    gains: tuple[float | None, ...]
    rests_on: tuple[str, ...]
    parameters: Mapping[str, Spread]
    fails_without: tuple[str, ...] = ()
    fails_with: tuple[str, ...] = ()
    refuted: bool = False

    @property
    def improved(self) -> int:
        """The number of recordings that the effect, fitted to the others, forecasts better."""
        return sum(gain is not None and gain > 0.0 for gain in self.gains) + len(self.fails_without)


@dataclasses.dataclass(frozen=True)
class Stability:
    """What becomes of the named effects when each recording is left out in turn.

    Args:
        left_out: the recordings; halves of it where there is only one, neighbours together where there are many.
        effects: the named effects.
        sentence: the same in words.
        sound: whether the words are no warning.
    """

    left_out: tuple[str, ...]
    effects: tuple[EffectStability, ...]
    sentence: str
    sound: bool

    def __str__(self) -> str:
        return self.sentence

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``diagnosis.json``."""
        plain = dataclasses.asdict(self)
        for effect in plain["effects"]:
            del effect["refuted"]  # such an effect is not named
        return {**plain, "left_out": list(self.left_out), "effects": [_listed(e) for e in plain["effects"]]}


def _part(share: float) -> str:
    """A share in per cent; little is not nothing."""
    return "under 1%" if 0.0 < share < 0.01 else f"{share:.0%}"


def _listed(values: dict[str, Any]) -> dict[str, Any]:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The result of :func:`~torch_activegp.diagnosis.diagnose`.

    Args:
        verdict: ``none``, ``named``, ``tie`` or ``unknown``.
        sentence: the verdict in words.
        effects: in the order in which they explain.
        details: the other entries of ``diagnosis.json``.
        evidence: what the report draws.
        files: further files to write, text or bytes by name: ``corrected.xml``, ``corrected.pt``, ``next.csv``, ...
        corrected: the simulator with the effects in it; see
            :func:`~torch_activegp.diagnosis.simulation.simulator.corrected_simulator`.
        learned: the same with a Gaussian process of the force that no effect explains, or None where there is none.
        stability: what becomes of the effects when each recording is left out, where there are effects.
    """

    verdict: str
    sentence: str
    effects: tuple[NamedEffect, ...]
    details: Mapping[str, Any]
    evidence: Mapping[str, Any]
    files: Mapping[str, str | bytes]
    corrected: Any = None
    learned: Any = None
    stability: Stability | None = None

    def __str__(self) -> str:
        lines = [self.sentence]
        for effect in self.effects:
            values = ", ".join(f"{name} {estimate}" for name, estimate in effect.parameters.items())
            ties = "".join(f"; or {name} at {target}" for name, target in effect.ties)
            excess = "; the simulator has too much of it" if effect.too_much else ""
            lines.append(f"  {effect.name} at {effect.target}: {values}; explains {_part(effect.share)}{excess}{ties}")
        along = [f"{effect['name']} at {effect['target']}" for effect in self.details.get("retuned", ())]
        lines += [f"  fitted along and not named: {', '.join(along)}"] if along else []
        if self.stability is not None and not self.stability.sound:
            lines.append(str(self.stability))
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """What ``diagnosis.json`` holds."""
        return {
            "schema_version": SCHEMA_VERSION,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "effects": [effect.to_dict() for effect in self.effects],
            "stability": None if self.stability is None else self.stability.to_dict(),
            **self.details,
        }

    def save(self, folder: Path | str) -> None:
        """Writes ``diagnosis.json``, ``evidence.json`` and the corrected model, each whole or not at all.

        Files of an earlier diagnosis that this one does not have (``corrected.xml``, ``next.csv``, ``learned.pt``, ...)
        are removed at the end; other files stay.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        contents = dict(self.files)
        contents["evidence.json"] = json.dumps(self.evidence)
        contents["diagnosis.json"] = json.dumps(self.to_dict(), indent=1)
        for name, content in contents.items():
            with written_whole(folder / name) as file:
                file.write(content.encode() if isinstance(content, str) else content)
        for name in _OWN:
            if name not in contents:
                (folder / name).unlink(missing_ok=True)
