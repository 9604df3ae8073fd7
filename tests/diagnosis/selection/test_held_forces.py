"""Truths of semi-implicit Euler that take a friction at the speed that a step begins with, as this file writes it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.given_numerics import numerics_of
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.held_forces import HeldForce, _held, of_held_forces
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.physics.effect import Step

STEP, DRAG, NOISE = 0.01, 0.4, 2e-5
NAMES = ("viscous_friction", "armature_error")
INERTIA, WEIGHT = 0.08 + 0.5**2 + 0.05, 9.81 * 0.5


def recorded(run, implicit: bool, rotor: float):
    """A run of the pendulum with a drag in steps as long as the rows', and a rotor that the model lacks."""
    q, v, angles = 0.4, 0.0, []
    for u in run.control[:, 0]:
        angles.append(q)
        force = -WEIGHT * np.sin(q) + u
        if implicit:
            v = (v + STEP * force / (INERTIA + rotor)) / (1.0 + STEP * DRAG / (INERTIA + rotor))
        else:
            v += STEP * (force - DRAG * v) / (INERTIA + rotor)
        q += STEP * v
    noisy = np.array([*angles, q])[:, None] + NOISE * np.random.default_rng(3).normal(size=(len(run), 1))
    return dataclasses.replace(run, position=noisy, smooth=noisy, velocity=np.gradient(noisy, STEP, axis=0))


def explained(clean, how, *more: str):
    """The names that other steps do without, the set that was found with some more names, and the rotor's."""
    machine = clean.integrated("Euler", STEP, 'armature="0.05"')
    runs = tuple(recorded(run, *how) for run in machine.fit)
    numerics = numerics_of(dataclasses.replace(machine, fit=runs), 1)
    segments = cut(runs, 0.5, 0.0)
    shooting = Shooting(numerics.given, segments, NoiseModel.white(np.array([NOISE])))
    nominal = shooting.fit([((), ())], numerics.given.starts(segments))[0]
    tried = effects_for(machine.model, machine.channels, runs)
    drag, rotor, *others = (next(e for e in tried if e.name == name) for name in (*NAMES, *more))
    sets = [((drag,), (np.array([DRAG]),))] * (not more)
    values = (np.array([DRAG]), np.array([-1e-3]), *(e.seeds[0] for e in others))
    fits = shooting.fit([*sets, ((drag, rotor, *others), values)], nominal.starts)
    selection = Selection(nominal, [nominal, *fits], Score(shooting.samples, 60, 1.0))
    return of_held_forces(numerics, numerics.given, shooting, selection), selection.best, rotor


@pytest.mark.parametrize("how", [(False, 0.0), (True, 0.0), (True, DRAG * STEP), (False, 0.02)])
def test_an_inertia_is_a_step_where_the_truth_took_its_friction_a_step_early_alone(clean, how) -> None:
    meant, best, rotor = explained(clean, how)
    assert len(best.effects) == (1 if how == (True, 0.0) else 2)
    assert meant == (frozenset({rotor}) if how == (False, 0.0) else frozenset())
    if how == (False, 0.0):
        assert best.by_effect[rotor][0] == pytest.approx(-DRAG * STEP, rel=0.05)


def test_what_does_not_pay_beside_a_held_force_goes_too(clean) -> None:
    meant, best, _ = explained(clean, (False, 0.0), "quadratic_drag")
    assert [effect.name for effect in best.effects] == [*NAMES, "quadratic_drag"]
    assert meant == frozenset(best.effects[1:])


def test_what_sticks_or_remembers_is_not_held(clean) -> None:
    names = {effect.name for effect in clean.effects if effect.target == "joint:hip" and _held(effect) is not None}
    assert names >= {"viscous_friction", "quadratic_drag", "linear_spring", "cubic_spring", "cogging"}
    assert not names & {"coulomb_friction", "stribeck_friction", "joint_stop", "backlash", "hysteresis"}


def test_a_held_force_is_of_the_state_that_a_step_begins_with(clean) -> None:
    """Not of where the joint is in the middle of the step."""
    spring = clean.effect("linear_spring")
    qpos, qvel, force = np.array([[0.3]]), np.array([[2.0]]), np.zeros((1, 1))
    step = Step(qpos, qvel, np.zeros((1, 1)), force, lambda name: np.zeros(1), np.array([0.1]), middle=0.5)
    values = np.array([[2.0, 0.1]])
    HeldForce.like(spring).before_step(step, np.array([0]), values, None)
    assert force[0, 0] == pytest.approx(spring.force(0.3, 2.0, values[0]))
    assert force[0, 0] != pytest.approx(spring.force(0.4, 2.0, values[0]))
