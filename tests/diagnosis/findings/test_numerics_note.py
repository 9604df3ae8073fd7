from __future__ import annotations

import pytest

from torch_activegp.diagnosis.findings import numerics_note as module
from torch_activegp.diagnosis.findings.forecast import FAILED, compare
from torch_activegp.diagnosis.findings.numerics_note import numerics_notes
from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.preparation.given_numerics import numerics_of
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import NOMINAL


def note_of(bench, given=None, step=0.01, fit=None, firm=False, **said) -> list[str]:
    """What is said where a model that says so was integrated as the bench is."""
    machine = bench.integrated("Euler", step)
    given = given or numerics_of(machine, 1).given
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 5, 1.0))
    found = Explanation(bench.engine, bench.shooting, selection, (), given, firm)
    chosen = fit or bench.nominal
    models = {"before": (bench.engine, NOMINAL), "after": (bench.engine, chosen.candidate)}
    holdout, _ = compare(models, machine.holdout, machine.channels.joints, bench.shooting.noise)
    for entry in holdout["runs"]:
        entry |= said
    return numerics_notes(found, machine, chosen, holdout)


def test_nothing_is_said_where_the_model_was_integrated_as_it_says(bench) -> None:
    assert note_of(bench, given=bench.engine) == []


def figures(note: str) -> dict[str, tuple[float, float]]:
    """Errors in the model's own steps and in those that were taken, and the noise twice."""
    said = {}
    for kind, words in module._KINDS.items():
        if f" {words} (for " in note:
            before, after = note.split(f" {words} (for ")
            said[kind] = float(before.split()[-1]), float(after.split()[0])
    return said | {"noise": (float(note.split("noise is ")[1].rstrip(".")),) * 2}


@pytest.mark.parametrize("named", [False, True])
def test_it_is_said_how_a_model_was_integrated_and_what_its_own_steps_do(bench, clean, named: bool) -> None:
    """Of the corrected model."""
    which = bench if named else clean
    fit = bench.fit("viscous_friction", 0.05) if named else clean.nominal
    (note,) = note_of(which, fit=fit)
    assert "integrated by Runge-Kutta in steps of 0.005 s: the recordings agree with" in note
    assert "as it stands (by semi-implicit Euler in steps of 0.01 s)" in note
    machine, noise = which.integrated("Euler", 0.01), which.shooting.noise
    engines = numerics_of(machine, 1).given, which.engine
    one, other = (
        compare({"before": (engine, NOMINAL), "own": (engine, fit.candidate)}, machine.holdout, ("hip",), noise)[0]
        for engine in engines
    )
    said = figures(note)
    for kind in module._KINDS:
        assert said[kind] == pytest.approx((one[kind]["own"], other[kind]["own"]), rel=0.01)
    assert said["noise"][0] == pytest.approx(one["one_step"]["noise"], rel=0.05)


def test_it_is_said_where_the_models_own_steps_do_as_well(clean) -> None:
    alike = numerics_of(clean.machine, 1).given
    assert alike is not clean.engine
    (note,) = note_of(clean, given=alike)
    assert note.endswith("In the model's own steps held-out runs are forecast no worse.")


@pytest.mark.parametrize("kind", list(module._KINDS))
def test_both_errors_must_be_no_worse(clean, monkeypatch, kind: str) -> None:
    def worse(models, runs, joints, noise):
        errors, traces = compare(models, runs, joints, noise)
        return errors | {kind: {name: 1.1 * error for name, error in errors[kind].items()}}, traces

    monkeypatch.setattr(module, "compare", worse)
    (note,) = note_of(clean, given=numerics_of(clean.machine, 1).given)
    assert "the errors on held-out runs" in note


def test_free_runs_that_nobody_can_forecast_say_nothing_of_the_steps(clean) -> None:
    (note,) = note_of(clean, step=0.02, predictable=False)
    assert "one step ahead" in note
    assert "free runs" not in note


def test_a_model_that_fails_in_its_own_steps_is_told(clean, monkeypatch) -> None:
    def failing(models, runs, joints, noise):
        errors, traces = compare(models, runs, joints, noise)
        failed = {"free_run": {"after": FAILED}, "one_step": {"after": 0.1}}
        return errors | {"runs": [*errors["runs"], failed]}, traces

    monkeypatch.setattr(module, "compare", failing)
    (note,) = note_of(clean)
    assert note.endswith("In the model's own steps the simulation of held-out runs fails.")


@pytest.mark.parametrize("firm", [True, False])
def test_effects_and_firm_friction_are_in_the_words(bench, firm: bool) -> None:
    (note,) = note_of(bench, fit=bench.fit("viscous_friction", 0.05), firm=firm)
    assert note.startswith("The effects were fitted with the model integrated by Runge-Kutta")
    assert ("sticks firmly" in note) is firm


@pytest.mark.parametrize(
    ("integrator", "step", "words"), [("RK4", 0.005, ""), ("RK4", 0.02, "4 times"), ("Euler", 0.01, "8 times")]
)
def test_it_is_said_how_much_slower_other_numerics_are(bench, integrator: str, step: float, words: str) -> None:
    """By evaluations: Runge-Kutta makes four in each time step."""
    machine = bench.integrated(integrator, step)
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 5, 1.0))
    found = Explanation(bench.engine, bench.shooting, selection, (), given=numerics_of(machine, 1).given)
    models = {"after": (bench.engine, bench.nominal.candidate)}
    holdout, _ = compare(models, machine.holdout, ("hip",), bench.shooting.noise)
    (note,) = numerics_notes(found, machine, bench.nominal, holdout)
    assert ("as long to simulate" in note) is bool(words)
    assert words in note


@pytest.mark.parametrize("named", [True, False])
def test_of_a_black_box_the_controls_are_told_alone(bench, black, named: bool) -> None:
    recordings = [black.record("none", 0)]
    box = BlackBox.of(black.simulator())
    machine = make_machine(box.model, recordings, recordings, box)
    forms = numerics_of(machine)
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 5, 1.0))
    found = Explanation(forms.fine, bench.shooting, selection, (), given=forms.given)
    chosen = bench.fit("viscous_friction", 0.05) if named else bench.nominal
    (note,) = numerics_notes(found, machine, chosen, {})
    assert "half a time step later" in note
    assert note.startswith("The effects were fitted with the controls of" if named else f"{box.name} had its controls")
