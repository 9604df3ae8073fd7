"""What the held-out runs, and doubts about the recordings, change in a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from torch_activegp.diagnosis.findings.doubts import reservation
from torch_activegp.diagnosis.findings.idle_names import without_idle
from torch_activegp.diagnosis.findings.unforeseen import seen_there, surprise
from torch_activegp.diagnosis.findings.unseen import foreseeable, refutation, taken_back
from torch_activegp.diagnosis.findings.unsure_runs import expected_error
from torch_activegp.diagnosis.findings.verdict import Verdict
from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Array, Run
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.simulation.touching import poses_that_touch


def reconsider(
    machine: Machine,
    explanation: Explanation,
    verdict: Verdict,
    chosen: Fit,
    holdout: Mapping[str, Any],
    starts: Array | Sequence[Sequence[float]],
) -> tuple[Explanation, Verdict] | None:
    """What is to be said instead, where the held-out runs, or doubts, speak against a verdict; None where nothing does.

    Args:
        machine: model and runs.
        explanation: the sets.
        verdict: what would be said.
        chosen: the set whose names would be.
        holdout: errors on the held-out runs, :func:`~torch_activegp.diagnosis.findings.unseen.marked`.
        starts: initial states with which the set follows these R runs, ``(R, nq + nv)``.
    """
    shooting = explanation.shooting
    wild = {entry["run"] for entry in holdout["runs"] if not entry.get("predictable", True)}
    if chosen.effects:

        def expected() -> float:
            calm = [i for i, run in enumerate(machine.holdout) if run.label not in wild]
            runs, engine = [machine.holdout[i] for i in calm], explanation.engine.without_leapfrog()
            return expected_error(engine, shooting, chosen, runs, np.asarray(starts)[calm])

        why = reservation(shooting, chosen, machine.doubts, machine.undriven)
        why = why or refutation(foreseeable(holdout), expected)
        if why is not None:
            return explanation, taken_back(verdict, why)
        return without_idle(explanation, chosen, machine.holdout)
    if verdict.judgement.verdict != "none":
        return None
    mute = {run.label for run in machine.holdout if run.label in wild and _touches(machine, run)}
    why = surprise([entry for entry in holdout["runs"] if entry["run"] not in mute], shooting)
    return None if why is None else seen_there(explanation, verdict, machine.holdout, why)


def _touches(machine: Machine, run: Run) -> bool:
    """Whether something touches in a run, or may: a black box says nothing of it.

    Forecasts by one step fail behind impacts whose begin is not seen: by 6000 times the noise on a leg of which nothing
    was missing.
    """
    return machine.box is not None or bool(poses_that_touch(machine.model, machine.channels, [run])[1].any())
