"""The oracle: who knows which effects are there fits them to the same data, and forecasts the same held-out runs."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco

from benchmarks.concealed.run import Way, digest
from benchmarks.concealed.translation import Form, forms_of, sets_of, true_forms
from torch_activegp.data import load_recordings
from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine
from torch_activegp.diagnosis.inputs.runs import median_step
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.inputs.source import read_source
from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.lengths import uncut
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.physics import Effect

_FINEST = 1e-3
_ADEQUATE = 1.15
"""Numerics do where chi2 per degree of freedom is below this."""

Sets = Sequence[tuple[Sequence[Effect], Sequence[Any]]]


@dataclasses.dataclass(frozen=True)
class Case:
    """The files of a case, laid over its model as the diagnosis does it."""

    machine: Machine
    effects: list[Effect]
    numerics: Numerics
    noise: NoiseModel
    segments: Segments

    @classmethod
    def read(cls, folder: Path) -> Case:
        """Read a case."""
        train, test = (load_recordings(sorted(folder.glob(f"{role}_*.csv"))) for role in ("train", "test"))
        machine = make_machine(read_source(str(folder / "model.xml")).model, train, test)
        return cls(
            machine,
            effects_for(machine.model, machine.channels, machine.fit),
            Numerics.of(machine, nthread=1),
            noise_floor(machine.fit),
            uncut(machine),
        )

    def engines(self) -> Iterator[Engine]:
        """Numerics to try, in order: of the diagnosis, fine, firm and as the model says, and steps of 1 ms."""
        yield self.numerics.fine
        if self.numerics.firm is not None:
            yield self.numerics.firm
        yield self.numerics.given
        count = max(round(median_step(self.machine.fit) / _FINEST), 1)
        if count > self.numerics.fine.substeps:
            yield Engine(self.machine.model, self.machine.channels, count, 1, int(mujoco.mjtIntegrator.mjINT_RK4))

    def fit(self, sets: Sets, engine: Engine) -> Fit:
        """The best of some sets: first the initial states alone, then all."""
        shooting = Shooting(engine, self.segments, self.noise)
        held = shooting.fit(sets, engine.starts(self.segments), hold=True)
        near = min(held, key=lambda fit: fit.chi2)
        return shooting.fit([(near.effects, near.values)], near.starts, near=near)[0]

    def dof(self, engine: Engine) -> int:
        """Samples less initial states."""
        return Shooting(engine, self.segments, self.noise).dof

    def best(self, sets: Sets) -> tuple[Engine, Fit]:
        """The best fit under the first numerics that do, or under those that do best."""
        tried: list[tuple[Engine, Fit]] = []
        for engine in self.engines():
            tried.append((engine, self.fit(sets, engine)))
            if tried[-1][1].chi2 < _ADEQUATE * self.dof(engine):
                break
        return min(tried, key=lambda pair: pair[1].chi2)


def true_sets(case: Case, key: Mapping[str, Any]) -> Sets:
    """The true effects with their true parameters, in every way in which the package can hold them.

    Where the nominal was tuned, what undoes that goes with them.
    """
    forms = [true_forms(truth, key, case.effects, case.machine.model) for truth in key["effects"]]
    return sets_of([*forms, *_forms(case, key["tuning"])])


def _forms(case: Case, entries: Sequence[Mapping[str, Any]]) -> list[list[Form]]:
    forms = []
    for entry in entries:
        words = {name: float(found["value"]) for name, found in entry["parameters"].items()}
        forms.append(forms_of(entry["name"], entry["target"], words, case.effects))
    return forms


def said_sets(case: Case, diagnosis: Mapping[str, Any]) -> Sets:
    """The effects that a diagnosis named first, and what it corrected without naming it, with its parameters."""
    return sets_of(_forms(case, [*diagnosis["effects"], *(diagnosis.get("retuned") or [])]))


def _said(folder: Path) -> Path:
    return folder.parents[1] / "results" / "diagnosis" / folder.name / "diagnosis.json"


def checked(folder: Path, answer: Path) -> bool:
    """Whether the oracle saw the tie that the diagnosis claims now, if it claims one."""
    said = _said(folder)
    if not said.exists() or json.loads(said.read_text(encoding="utf-8"))["verdict"] != "tie":
        return True
    seen = json.loads(answer.read_text(encoding="utf-8"))
    return "chi2" not in seen or seen.get("diagnosis") == digest(said)


def consult(folder: Path, out: Path) -> None:
    """Write oracle.json for one case: errors on the held-out runs, and how well a tie fits beside the truth."""
    root = folder.parents[1]
    key = json.loads((root / "keys" / f"{folder.name}.json").read_text(encoding="utf-8"))
    answer: dict[str, Any] = {"case": folder.name}
    if key["effects"] and key["kind"] != "outside":
        case = Case.read(folder)
        engine, fit = case.best(true_sets(case, key))
        models = {"oracle": (engine, fit.candidate)}
        holdout, _ = compare(models, case.machine.holdout, case.machine.channels.joints, case.noise)
        answer |= {
            "holdout": {measure: holdout[measure] for measure in ("one_step", "free_run")},
            "effects": [
                {"name": e.name, "target": e.target, "parameters": e.describe(v)}
                for e, v in zip(fit.effects, fit.values, strict=True)
            ],
            "chi2": fit.chi2, "dof": case.dof(engine), "parameters": fit.size,
        }  # fmt: skip
        said = _said(folder)
        answer["diagnosis"] = digest(said)
        diagnosis = json.loads(said.read_text(encoding="utf-8")) if said.exists() else {"verdict": "none"}
        claimed = said_sets(case, diagnosis) if diagnosis["verdict"] == "tie" else []
        if claimed:
            other = case.fit(claimed, engine)
            answer["tie"] = {"chi2": other.chi2, "parameters": other.size}
    out.mkdir(parents=True, exist_ok=True)
    (out / "oracle.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")


ORACLE = Way("oracle", consult, "oracle.json", ("torch_activegp.diagnosis", "benchmarks.concealed.oracle"), checked)
