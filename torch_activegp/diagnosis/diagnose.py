"""From a simulator and recordings to a diagnosis."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from torch_activegp.data import Recording
from torch_activegp.diagnosis.checkpoint import Checkpoint
from torch_activegp.diagnosis.findings.entries import named_effects, recording_entries, retuned_entries, rival_entries
from torch_activegp.diagnosis.findings.evidence import laws, map_region, map_time
from torch_activegp.diagnosis.findings.forecast import compare, without_model
from torch_activegp.diagnosis.findings.late_controls import doubt_rows, half_a_row
from torch_activegp.diagnosis.findings.locate import entries, locate, somewhere
from torch_activegp.diagnosis.findings.notes import outcome_notes, search_notes
from torch_activegp.diagnosis.findings.numerics_note import numerics_notes
from torch_activegp.diagnosis.findings.proposal import propose
from torch_activegp.diagnosis.findings.reconsider import reconsider
from torch_activegp.diagnosis.findings.remainder import Outcome, misleads, model_remainder
from torch_activegp.diagnosis.findings.short_steps import numbers_of
from torch_activegp.diagnosis.findings.turned_controls import doubt_places, doubt_signs
from torch_activegp.diagnosis.findings.unseen import is_predictable, marked
from torch_activegp.diagnosis.findings.verdict import Verdict, decide
from torch_activegp.diagnosis.findings.words import sentence, unforeseen
from torch_activegp.diagnosis.inputs.blackbox import accelerations
from torch_activegp.diagnosis.inputs.fingerprint import fingerprint
from torch_activegp.diagnosis.inputs.machine import Machine, check_given, make_machine
from torch_activegp.diagnosis.inputs.runs import Array, input_addresses, median_step
from torch_activegp.diagnosis.inputs.source import Source, read_source
from torch_activegp.diagnosis.preparation.filtered_rows import thinned
from torch_activegp.diagnosis.preparation.missing_rows import as_the_machine_moved
from torch_activegp.diagnosis.result import Diagnosis, NamedEffect
from torch_activegp.diagnosis.selection.explain import Explanation, explain
from torch_activegp.diagnosis.selection.judge import Judgement
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import linearize
from torch_activegp.diagnosis.simulation.blackbox_simulator import simulator_with
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.correction import Form, corrected_xml
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.diagnosis.simulation.saved import saved_files
from torch_activegp.physics.effect import Effect

_logger = logging.getLogger(__name__)
_WORTH_LEARNING = 0.03
"""A remainder of a smaller part of the mismatch is not modelled."""

_DONE = {
    "noise floor": 0.02,
    "naming in brief pieces": 0.1,
    "naming on a part of the data": 0.3,
    "naming on all data": 0.7,
    "naming with the noise seen behind the effects": 0.75,
    "naming with the numerics seen behind the effects": 0.8,
}
"""Part of the time that is usually gone when a stage begins; where there is little to explain, more is."""

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
        holdout: runs that are forecast, and choose no name; without any, the last fifth of the runs is set aside (of
            one or two, the last fifth of the longest), and the notes say which.
        effects: classes of your own, which are tried beside those on the list wherever they can act.
        seed: of the controls proposed for the next experiment; nothing else is random.
        nthread: threads of the simulations; 0 for all cores.
        tell: hears the name of each stage and which part of the work is usually done by then, 0 to 1.
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
    machine = thinned(as_the_machine_moved(machine, nthread), nthread)
    for note in machine.notes:
        _logger.warning("%s", note)
    tried = effects_for(machine.model, machine.channels, machine.fit, effects)
    if source.box is not None:
        tried = accelerations(tried)
    if checkpoint is not None:
        checkpoint.open(fingerprint(source, machine, tried, seed))
    try:
        explanation = explain(machine, tried, nthread, _usually_done(say), checkpoint)
        say("weighing the evidence", 0.9)
        verdict = decide(explanation.shooting, explanation.selection, explanation.effects)
        return _report(source, machine, explanation, verdict, seed, say)
    finally:
        linearize.cache_clear()  # holds likelihood and recordings


def _usually_done(say: Tell) -> Callable[[str], None]:
    """Tells stages with the part of the work that is usually done; within one, and where one comes again, it stays."""
    done = 0.0

    def tell(words: str) -> None:
        nonlocal done
        done = max(done, _DONE.get(words, done))
        say(words, done)

    return tell


def _report(
    source: Source, machine: Machine, explanation: Explanation, verdict: Verdict, seed: int, say: Tell
) -> Diagnosis:
    shooting, nominal = explanation.shooting, explanation.selection.nominal
    judgement = verdict.judgement
    say("locating", 0.93)
    mismatch = max(nominal.chi2 - shooting.dof, 0.0)
    regions = locate(shooting, nominal) if judgement.verdict != "none" else []
    places = somewhere(_certain(judgement))
    say("forecasting held-out runs", 0.95)
    chosen = judgement.fit if judgement.verdict in ("named", "tie") else nominal
    engine = explanation.engine.without_leapfrog()  # which `corrected.xml` cannot ask of MuJoCo
    outcome = None if verdict.unforeseen else _remainder(explanation, judgement, chosen)
    outcome, holdout, traces = _forecasts(machine, shooting, engine, chosen, outcome)
    starts = [trace["start_after"] for trace in traces[:: len(machine.channels.joints)]]
    wild_notes: list[str] = []
    if judgement.verdict != "unknown":  # of a simulator that is known to be wrong it says nothing
        calm = is_predictable(engine, chosen.candidate, machine.holdout, starts)
        holdout, wild_notes = marked(holdout, machine.holdout, calm.tolist())
    others = reconsider(machine, explanation, verdict, chosen, holdout, starts)
    if others is not None:
        return _report(source, machine, *others, seed, say)
    say("writing the correction", 0.99)
    numerics = None
    if explanation.fine:
        step = median_step(machine.fit)
        numerics = Form(engine.model.opt.integrator, step / engine.substeps, explanation.firm, engine.explicit)
    xml, held, difference = corrected_xml(source.spec, chosen.effects, chosen.values, numerics)
    corrected = simulator_with(source, machine.channels, chosen.candidate, xml if all(held) else None, numerics)
    learned = None
    if outcome is not None and outcome.effect is not None:
        learned = simulator_with(source, machine.channels, outcome.on(chosen.candidate), None, numerics)
    numbers = numbers_of(explanation.engine, shooting, chosen, xml is not None and all(held))
    named, open_notes = named_effects(explanation, judgement, dict(zip(chosen.effects, held, strict=True)), numbers)
    files: dict[str, str | bytes] = {}
    if xml is not None:
        files["corrected.xml"] = xml
    late = _late(explanation, judgement, say)
    doubts = [*late, *machine.doubts, *machine.undriven, *machine.lacks]
    proposal = propose(explanation, judgement, machine.fit, seed, doubts)
    if proposal is not None:
        files["next.csv"] = proposal[1]
    remains = chosen.chi2 / max(shooting.dof - chosen.size, 1)
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
            "chi2_per_dof": remains,
        },
        "fit": {"holdout": holdout},
        "next_experiment": None if proposal is None else proposal[0],
        "model": {"name": source.name, "source": source.path},
        "recordings": recording_entries(machine),
        "notes": [
            *machine.notes,
            *late,
            *half_a_row(judgement, machine.notes, median_step(machine.fit)),
            *numerics_notes(explanation, machine, chosen, holdout),
            *search_notes(explanation, chosen.effects),
            *outcome_notes(explanation, judgement.verdict, remains, holdout, machine.model),
            *([] if outcome is None else outcome.notes),
            *numbers.notes,
            *open_notes,
            *wild_notes,
            *verdict.notes,
            *([verdict.clock] if verdict.clock else []),
        ],
        "rivals": rival_entries(explanation, judgement),
        "retuned": retuned_entries(explanation, judgement, numbers.fit),
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
    words = unforeseen(verdict.unforeseen, doubts) or sentence(
        judgement.verdict, named, details, doubts, bool(verdict.clock)
    )
    files |= saved_files({"corrected.pt": corrected, "learned.pt": learned}, details["notes"])
    details["notes"] += _held_note(named) if "corrected.pt" in files else []
    return Diagnosis(judgement.verdict, words, named, details, evidence, files, corrected, learned, verdict.stability)


def _forecasts(
    machine: Machine, shooting: Shooting, engine: Engine, chosen: Fit, outcome: Outcome | None
) -> tuple[Outcome | None, dict[str, Any], list[dict[str, Any]]]:
    """How well held-out runs are forecast, and the traces; without a learned force that misleads there."""
    models = {"before": (engine, NOMINAL), "after": (engine, chosen.candidate if chosen.effects else NOMINAL)}
    if outcome is not None and outcome.effect is not None:
        models["gp"] = (engine, outcome.on(chosen.candidate))
    holdout, traces = compare(models, machine.holdout, machine.channels.joints, shooting.noise)
    if outcome is not None and "gp" in models and misleads(holdout):
        outcome = outcome.withheld(holdout)
        holdout, traces = without_model("gp", holdout, traces)
    return outcome, holdout, traces


def _late(explanation: Explanation, judgement: Judgement, say: Tell) -> list[str]:
    """Whether controls seem to be logged late, turned or interchanged, where nothing explains the mismatch."""
    if judgement.verdict != "unknown":
        return []
    say("looking at rows, signs and places of the controls", 0.99)
    return doubt_rows(explanation) or doubt_signs(explanation) or doubt_places(explanation)


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


def _held_note(named: Sequence[NamedEffect]) -> list[str]:
    """Which named effects no file of MuJoCo's holds, and what does."""
    beyond = [f"{effect.name} at {effect.target}" for effect in named if effect.mjcf is False]
    if not beyond:
        return []
    return [
        f"MJCF cannot hold {' and '.join(beyond)} here: the whole corrected model is corrected.pt, for "
        "`load_corrected` and, without effects of your own, for `torch-activegp evaluate`."
    ]
