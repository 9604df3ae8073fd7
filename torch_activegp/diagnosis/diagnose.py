"""From a simulator and recordings to a diagnosis."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from torch_activegp.data import Recording
from torch_activegp.diagnosis.checkpoint import Checkpoint
from torch_activegp.diagnosis.findings.evidence import laws, map_region, map_time
from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.findings.locate import entries, locate, somewhere
from torch_activegp.diagnosis.findings.notes import search_notes
from torch_activegp.diagnosis.findings.proposal import propose
from torch_activegp.diagnosis.findings.remainder import Outcome, model_remainder
from torch_activegp.diagnosis.findings.verdict import Verdict, decide
from torch_activegp.diagnosis.findings.words import sentence
from torch_activegp.diagnosis.inputs.blackbox import accelerations
from torch_activegp.diagnosis.inputs.fingerprint import fingerprint
from torch_activegp.diagnosis.inputs.machine import Machine, check_given, make_machine
from torch_activegp.diagnosis.inputs.runs import Array, input_addresses, median_step
from torch_activegp.diagnosis.inputs.source import Source, read_source
from torch_activegp.diagnosis.result import Diagnosis, NamedEffect
from torch_activegp.diagnosis.selection.explain import Explanation, explain
from torch_activegp.diagnosis.selection.intervals import estimates
from torch_activegp.diagnosis.selection.judge import Judgement
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.linearize import linearize
from torch_activegp.diagnosis.simulation.blackbox_simulator import simulator_with
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.correction import Form, corrected_xml
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.diagnosis.simulation.saved import saved
from torch_activegp.diagnosis.simulation.simulator import EffectSimulator
from torch_activegp.errors import ConfigurationError
from torch_activegp.physics.effect import Effect
from torch_activegp.simulators import Simulator

_logger = logging.getLogger(__name__)
_SHOWN = 8
"""So many rivals are reported, and the nominal."""
_WORTH_LEARNING = 0.03
"""A remainder of a smaller part of the mismatch is not modelled."""

Tell = Callable[[str, float | None], None]


@threadpool_limits.wrap(limits=1)  # many small matrices: beside another process, threads took ten times as long
def diagnose(
    model: object,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    *,
    effects: Sequence[type[Effect]] = (),
    seed: int = 0,
    nthread: int = 0,
    tell: Tell | None = None,
    checkpoint: Checkpoint | None = None,
) -> Diagnosis:
    """Says where and why a simulator and recordings differ, and corrects the simulator.

    Args:
        model: path of an MJCF file, MJCF text, an ``MjSpec``, an ``MjModel``, a `MujocoSimulator`, or any other
            `Simulator` whose state is positions and their velocities; then effects act as accelerations.
        recordings: runs for fitting and selection.
        holdout: runs that are only forecast; without any, the last fifth of the runs is set aside (of one or two, the
            last fifth of the longest), and the notes say which.
        effects: classes of your own, which are tried beside those on the list wherever they can act.
        seed: of the controls proposed for the next experiment; nothing else is random.
        nthread: threads of the simulations; 0 for all cores.
        tell: hears the name of each stage and the part of the work that is done.
        checkpoint: keeps finished stages in a file, from which the same call goes on after an interruption.

    Returns:
        The diagnosis.

    Logs what it decided about the recordings, as warnings, before it computes; they are in the notes too.

    Raises:
        DataError: a recording does not fit the model.
        ConfigurationError: a model that does not compile or cannot be simulated in batches, or whose state is another;
            a class of your own that cannot be placed.
        SimulationError: a simulator fails, or returns something else than next states.
    """
    say = tell or (lambda words, done: None)
    say("reading", 0.0)
    recordings, holdout = check_given(recordings, "diagnose"), check_given(holdout or (), "diagnose")
    source = read_source(model)
    machine = make_machine(source.model, recordings, holdout, source.box)
    for note in machine.notes:
        _logger.warning("%s", note)
    tried = effects_for(machine.model, machine.channels, machine.fit, effects)
    if source.box is not None:
        tried = accelerations(tried)
    if checkpoint is not None:
        checkpoint.open(fingerprint(source, machine, tried, seed))
    try:
        explanation = explain(machine, tried, nthread, lambda words: say(words, None), checkpoint)
        say("weighing the evidence", 0.7)
        return _report(source, machine, explanation, decide(explanation.shooting, explanation.selection), seed, say)
    finally:
        linearize.cache_clear()  # holds likelihood and recordings


def _report(
    source: Source, machine: Machine, explanation: Explanation, verdict: Verdict, seed: int, say: Tell
) -> Diagnosis:
    shooting, nominal = explanation.shooting, explanation.selection.nominal
    judgement = verdict.judgement
    say("locating", 0.8)
    mismatch = max(nominal.chi2 - shooting.dof, 0.0)
    regions = locate(shooting, nominal) if judgement.verdict != "none" else []
    places = somewhere(_certain(judgement))
    say("forecasting held-out runs", 0.85)
    chosen = judgement.fit if judgement.verdict in ("named", "tie") else nominal
    engine = explanation.engine.without_leapfrog()  # which `corrected.xml` cannot ask of MuJoCo
    models = {"before": (engine, NOMINAL), "after": (engine, chosen.candidate if chosen.effects else NOMINAL)}
    outcome = _remainder(explanation, judgement, chosen)
    if outcome is not None and outcome.effect is not None:
        models["gp"] = (engine, outcome.on(chosen.candidate))
    holdout, traces = compare(models, machine.holdout, machine.channels.joints, shooting.noise)
    say("writing the correction", 0.95)
    numerics = None
    if explanation.fine:
        step = median_step(machine.fit)
        numerics = Form(engine.model.opt.integrator, step / engine.substeps, explanation.firm)
    xml, held, difference = corrected_xml(source.spec, chosen.effects, chosen.values, numerics)
    corrected = simulator_with(source, machine.channels, chosen.candidate, xml if all(held) else None, numerics)
    learned = None
    if "gp" in models:
        learned = simulator_with(source, machine.channels, models["gp"][1], None, numerics)
    named = _named(explanation, judgement, dict(zip(chosen.effects, held, strict=True)))
    files: dict[str, str | bytes] = {}
    if xml is not None:
        files["corrected.xml"] = xml
    proposal = propose(explanation, judgement, machine.fit, seed)
    if proposal is not None:
        files["next.csv"] = proposal[1]
    details: dict[str, Any] = {
        "mismatch": {
            "detected": judgement.verdict != "none",
            "p_value": judgement.p_value,
            "chi2_per_dof": nominal.chi2 / shooting.dof,
            "noise": {
                f"qpos.{joint}": float(scale)
                for joint, scale in zip(machine.channels.joints, shooting.noise.scale, strict=True)
            },
        },
        "location": entries(regions, mismatch, places),
        "unexplained": {
            "share": judgement.unexplained,
            "white": judgement.white,
            "chi2_per_dof": chosen.chi2 / max(shooting.dof - chosen.size, 1),
        },
        "fit": {"holdout": holdout},
        "next_experiment": None if proposal is None else proposal[0],
        "model": {"name": source.name, "source": source.path},
        "recordings": _recordings(machine),
        "notes": [*machine.notes, *search_notes(explanation, machine.model), *_remainder_note(outcome), *verdict.notes],
        "rivals": _rivals(explanation, judgement),
        "retuned": _retuned(explanation, judgement),
        "mjcf_diff": difference if chosen.effects else None,
        "remainder": None if outcome is None else outcome.details,
    }
    left = locate(shooting, chosen, regions) if regions and chosen.effects else regions
    evidence = {
        "map_time": map_time(shooting, nominal, chosen),
        "map_region": map_region(regions, left),
        "laws": laws(machine.channels, left, chosen, judgement.named) if named else [],
        "traces": traces,
    }
    words = sentence(judgement.verdict, named, details)
    files |= _saved({"corrected.pt": corrected, "learned.pt": learned}, details["notes"])
    return Diagnosis(judgement.verdict, words, named, details, evidence, files, corrected, learned, verdict.stability)


def _saved(simulators: Mapping[str, Simulator | None], notes: list[str]) -> dict[str, str | bytes]:
    """Files of those that MJCF cannot hold, and a note on each that no file can."""
    files: dict[str, str | bytes] = {}
    for name, simulator in simulators.items():
        if isinstance(simulator, EffectSimulator):
            try:
                files[name] = saved(simulator)
            except ConfigurationError as error:
                notes.append(f"{name} is not written: {error}")
    return files


def _certain(judgement: Judgement) -> list[tuple[Effect, Array]]:
    """The named effects with their parameters, where nothing could stand in for them."""
    if judgement.verdict not in ("named", "tie"):
        return []
    values = judgement.fit.by_effect
    named = zip(judgement.named, judgement.ties, strict=True)
    return [(effect, values[effect]) for effect, ties in named if not ties]


def _remainder(explanation: Explanation, judgement: Judgement, chosen: Fit) -> Outcome | None:
    """A Gaussian process of what is left, where something is, and some segments can be kept from its training."""
    if judgement.verdict == "none" or judgement.white or judgement.unexplained < _WORTH_LEARNING:
        return None
    if explanation.shooting.segments.size < 2:
        return None
    engine = explanation.engine
    joints, inputs = engine.channels.joints, {at: name for name, at in input_addresses(engine.model).items()}
    names = [
        *(f"qpos.{joint}" for joint in joints),
        *(f"qvel.{joint}" for joint in joints),
        *(f"ctrl.{inputs.get(i, i)}" for i in range(engine.model.nu)),
    ]
    return model_remainder(explanation.shooting, chosen, names)


def _remainder_note(outcome: Outcome | None) -> list[str]:
    if outcome is None or outcome.effect is not None:
        return []
    return [
        "A Gaussian process of the force that is left, over positions, velocities and controls, did not improve "
        "forecasts on data kept from its training; it is not used."
    ]


def _named(explanation: Explanation, judgement: Judgement, held: dict[Any, bool | None]) -> tuple[NamedEffect, ...]:
    if judgement.verdict not in ("named", "tie"):
        return ()
    values = judgement.fit.by_effect
    return tuple(
        NamedEffect(
            effect.name,
            effect.target,
            effect.law_with(values[effect]),
            share,
            probability,
            estimates(explanation.shooting, judgement.fit, effect),
            ties,
            held.get(effect, False),
            effect.too_much(values[effect]),
        )
        for effect, share, probability, ties in zip(
            judgement.named, judgement.shares, judgement.probabilities, judgement.ties, strict=True
        )
    )


def _retuned(explanation: Explanation, judgement: Judgement) -> list[dict[str, Any]]:
    """What goes into the correction without a name."""
    out = []
    for effect in judgement.retuned if judgement.verdict in ("named", "tie") else ():
        values = estimates(explanation.shooting, judgement.fit, effect)
        parameters = {k: {"value": e.value, "unit": e.unit, "ci95": list(e.ci95)} for k, e in values.items()}
        out.append({"name": effect.name, "target": effect.target, "parameters": parameters})
    return out


def _rivals(explanation: Explanation, judgement: Judgement) -> list[dict[str, Any]]:
    dof = explanation.shooting.dof
    within = explanation.selection.within  # a set that was given up in a race fits worse than a part of itself
    ended = [rival for rival in judgement.rivals if rival[0] is judgement.fit or within(rival[0]) is None]
    shown = [rival for i, rival in enumerate(ended) if i < _SHOWN or not rival[0].effects]
    return [
        {
            "effects": [{"name": name, "target": target} for name, target in (e.key for e in fit.effects)],
            "chi2_per_dof": fit.chi2 / max(dof - fit.size, 1),
            "delta_bic": distance,
            "probability": weight,
        }
        for fit, distance, weight in shown
    ]


def _recordings(machine: Machine) -> list[dict[str, Any]]:
    return [
        {
            "name": run.label,
            "role": role,
            "rows": int(run.counted.sum()),
            "seconds": float(run.time[-1]),
            "rate_hz": float(1.0 / np.median(run.dt)),
            "notes": [],
        }
        for role, runs in (("fit", machine.fit), ("holdout", machine.holdout))
        for run in runs
    ]
