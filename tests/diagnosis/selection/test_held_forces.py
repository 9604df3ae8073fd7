"""Truths that take a missing force at the state that a time step begins with, as this file writes them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.given_numerics import numerics_of
from torch_activegp.diagnosis.selection import held_forces as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.held_forces import of_held_forces
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.physics.held_force import HeldForce

ROW, DRAG, SPRING, OWN, NOISE = 0.01, 0.4, 2.0, 0.2, 2e-5
INERTIA, WEIGHT = 0.08 + 0.5**2 + 0.05, 9.81 * 0.5
DRAGGED, SPRUNG = ("viscous_friction", "armature_error"), ("cubic_spring", "viscous_friction")


def damped(q, v, u, h, weight, implicit, rotor):
    """A step of semi-implicit Euler with a drag, and a rotor that the model lacks."""
    force = u - weight * np.sin(q)
    if implicit:
        v = (v + h * force / (INERTIA + rotor)) / (1.0 + h * DRAG / (INERTIA + rotor))
    else:
        v += h * (force - DRAG * v) / (INERTIA + rotor)
    return q + h * v, v


def sprung(q, v, u, h, weight, implicit, rotor):
    """A step of Runge-Kutta, with a damping that the model has, beside a spring that is held over it."""
    held = u - SPRING * q**3

    def slope(x):
        return np.array([x[1], (held - weight * np.sin(x[0]) - OWN * x[1]) / INERTIA])

    x = np.array([q, v])
    a = slope(x)
    b = slope(x + h / 2 * a)
    c = slope(x + h / 2 * b)
    return x + h / 6 * (a + 2 * b + 2 * c + slope(x + h * c))


def recorded(run, step, parts, noise, *how):
    """A run in so many steps a row."""
    q, v, angles = 0.4, 0.0, []
    for u in run.control[:, 0]:
        angles.append(q)
        for _ in range(parts):
            q, v = step(q, v, u, ROW / parts, *how)
    noisy = np.array([*angles, q])[:, None] + noise * np.random.default_rng(3).normal(size=(len(run), 1))
    return dataclasses.replace(run, position=noisy, smooth=noisy, velocity=np.gradient(noisy, ROW, axis=0))


@dataclasses.dataclass(frozen=True)
class Found:
    """The forms of the model, the likelihood, and the sets of some names."""

    numerics: object
    shooting: Shooting
    selection: Selection

    def told(self, engine=None, **changed) -> list[str]:
        """The names that go."""
        selection = dataclasses.replace(self.selection, **changed)
        forms = self.numerics
        gone = of_held_forces(forms, engine or forms.given, self.shooting, selection)
        return [effect.name for effect in selection.best.effects if effect in gone]


def find(clean, how=(False, 0.0), names=DRAGGED, parts=1, weight=WEIGHT, integrator="Euler", noise=NOISE) -> Found:
    """The first names alone and all of them, fitted to a truth."""
    damping = 0.0 if integrator == "Euler" else OWN
    machine = clean.integrated(integrator, ROW / parts, f'armature="0.05" damping="{damping}"')
    if not weight:
        machine.model.opt.gravity[:] = 0.0
    step = damped if integrator == "Euler" else sprung
    runs = tuple(recorded(run, step, parts, noise, weight, *how) for run in machine.fit)
    numerics = numerics_of(dataclasses.replace(machine, fit=runs), 1)
    segments = cut(runs, 0.5, 0.0)
    shooting = Shooting(numerics.given, segments, NoiseModel.white(np.array([noise])))
    nominal = shooting.fit([((), ())], numerics.given.starts(segments))[0]
    tried = effects_for(machine.model, machine.channels, runs)
    effects = tuple(next(e for e in tried if e.name == name) for name in names)
    first = DRAG if integrator == "Euler" else SPRING
    values = (np.array([first]), np.array([-1e-3]), *(e.seeds[0] for e in effects[2:]))
    sets = [(effects[:1], values[:1])] * (len(names) == 2)
    fits = shooting.fit([*sets, (effects, values)], nominal.starts)
    return Found(numerics, shooting, Selection(nominal, [nominal, *fits], Score(shooting.samples, 60, 1.0)))


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("how", [(False, 0.0), (True, 0.0), (True, DRAG * ROW), (False, 0.02)])
def test_an_inertia_is_a_step_where_the_truth_took_its_friction_a_step_early_alone(clean, how, parts) -> None:
    found = find(clean, how, parts=parts)
    best = found.selection.best
    assert len(best.effects) == (1 if how == (True, 0.0) else 2)
    assert found.told() == (["armature_error"] if how == (False, 0.0) else [])
    if how == (False, 0.0):
        assert best.values[1][0] == pytest.approx(-DRAG * ROW / parts, rel=0.1)


def test_a_rotor_of_just_a_step_cannot_be_told_from_one(clean) -> None:
    """By no recording: the equations are the same."""
    assert find(clean, (True, -DRAG * ROW)).told() == ["armature_error"]


def test_a_load_may_be_a_step_too_where_nothing_pulls_at_it(clean) -> None:
    assert find(clean, names=("viscous_friction", "payload_mass"), weight=0.0).told() == ["payload_mass"]


def test_a_damping_may_be_a_step_of_runge_kutta_beside_a_held_spring(clean) -> None:
    found = find(clean, names=SPRUNG, integrator="RK4", noise=2e-4)
    assert found.selection.best.values[1][0] < 0.0
    assert found.told() == ["viscous_friction"]


def test_what_does_not_pay_beside_a_held_force_goes_too(clean) -> None:
    """One after the other, beside what is left by then."""
    found = find(clean, names=(*DRAGGED, "quadratic_drag", "constant_force"))
    assert found.told() == ["armature_error", "quadratic_drag", "constant_force"]


def test_any_form_may_be_the_one_over_whose_steps_forces_were_held(clean) -> None:
    found = find(clean)
    given, fine = found.numerics.given, found.numerics.fine
    assert found.told(fine) == ["armature_error"]
    other = dataclasses.replace(found, numerics=dataclasses.replace(found.numerics, given=fine))
    assert other.told(given) == ["armature_error"]
    assert other.told(fine) == []


def test_a_held_law_costs_what_it_costs_otherwise(clean) -> None:
    """Behind a tuned nominal what is tunable costs little."""
    found = find(clean)
    free = frozenset(effect.key for effect in found.selection.best.effects)
    score = dataclasses.replace(found.selection.score, free=free)
    assert found.told(score=score) == ["armature_error"]


@pytest.mark.parametrize(("bar", "value"), [("_MOST", 0.5), ("_LOUD", 0.5)])
def test_what_is_larger_than_a_step_stays_and_all_where_much_is_missing(clean, monkeypatch, bar, value) -> None:
    found = find(clean)
    assert found.told(cut_short=True) == []
    monkeypatch.setattr(module, bar, value)
    assert found.told() == []


def test_on_a_joint_that_is_not_recorded_no_force_has_a_slope(clean) -> None:
    held = HeldForce.like(clean.effect("viscous_friction"))
    assert module._slopes(clean.shooting, held, np.array([0.2]))[0] == pytest.approx(0.2)
    elsewhere = dataclasses.replace(held, dof=held.dof + 1)
    np.testing.assert_array_equal(module._slopes(clean.shooting, elsewhere, np.array([0.2])), 0.0)


def test_of_a_black_box_nothing_is_a_step(bench, black) -> None:
    """Nobody knows how it steps, and the model in its place has no damping to speak of."""
    recordings = [black.record("none", 0)]
    box = BlackBox.of(black.simulator())
    forms = numerics_of(make_machine(box.model, recordings, recordings, box))
    fit = bench.fit("viscous_friction", 0.05)
    selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))
    shooting = dataclasses.replace(bench.shooting, engine=forms.fine)  # whose damping is without bounds
    assert of_held_forces(forms, forms.fine, shooting, selection) == frozenset()
