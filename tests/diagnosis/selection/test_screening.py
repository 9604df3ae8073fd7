from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.screening import Screen, _atom, screen
from torch_activegp.diagnosis.simulation.candidate import Candidate


@pytest.fixture(scope="module")
def screened(bench) -> Screen:
    return screen(bench.shooting, bench.nominal, bench.effects)


def test_the_injected_effect_is_ranked_first_of_the_linear_ones(bench, screened) -> None:
    best = screened.best()
    single = [atom for atom in best if len(atom.effect.parameters) == 1]
    assert single[0].effect.key == ("viscous_friction", "joint:hip")
    assert single[0].values[0] == pytest.approx(bench.viscous, rel=0.15)
    assert [atom.gain for atom in best] == sorted((atom.gain for atom in best), reverse=True)
    assert len({atom.effect for atom in best}) == len(best)


def test_the_promised_gain_is_what_a_fit_gains(bench, screened) -> None:
    atom = next(a for a in screened.best() if a.effect.name == "viscous_friction")
    fit = bench.shooting.fit([((atom.effect,), (atom.values,))], bench.nominal.starts)[0]
    assert atom.gain == pytest.approx(bench.nominal.chi2 - fit.chi2, rel=0.1)


@pytest.mark.parametrize(
    ("name", "target"),
    [
        ("coulomb_friction", "joint:hip"),
        ("constant_force", "joint:hip"),
        ("armature_error", "joint:hip"),
        ("actuator_gain", "actuator:drive"),
        ("sensor_bias", "sensor:hip"),
        ("payload_mass", "body:rod"),
    ],
)
def test_the_column_of_an_effect_is_its_simulated_change(clean, name, target) -> None:
    """A clean pendulum with a little of an effect simulated into its positions: the screen finds that much of it."""
    effect = clean.effect(name, target)
    amount = 0.2 * np.array([effect.parameters[0].scale])
    changed = clean.predict(Candidate((effect,), (amount,))) - clean.predict(clean.nominal.candidate)
    seen = dataclasses.replace(clean.segments, position=clean.predict(clean.nominal.candidate) + changed)
    (atom,) = screen(dataclasses.replace(clean.shooting, segments=seen), clean.nominal, [effect]).best()
    assert atom.values[0] == pytest.approx(amount[0], rel=0.2)


@pytest.mark.parametrize(
    ("name", "target", "value"),
    [
        ("actuator_dead_zone", "actuator:drive", 0.0005),
        ("actuator_delay", "actuator:drive", 0.0008),
        ("actuator_lag", "actuator:drive", 0.0012),
        ("sensor_delay", "sensor:hip", 0.001),
    ],
)
def test_the_first_guess_of_a_shape_without_amplitudes_is_close_to_it(clean, name, target, value) -> None:
    """Below all seeds too: what a seed does, times the share of it that fits."""
    effect, truth = clean.effect(name, target), np.array([value])
    there = clean.predict(Candidate((effect,), (truth,)))
    seen = dataclasses.replace(clean.segments, position=there)
    screened = screen(dataclasses.replace(clean.shooting, segments=seen), clean.nominal, [effect])
    (best,) = screened.best()
    assert best.values[0] == pytest.approx(value, rel=0.35)


@pytest.mark.parametrize(
    ("number", "amplitude", "wanted"),
    [(2, 1.0, (2, 1.0)), (2, 50.0, (3, 1.0)), (2, 0.001, (1, 1.0)), (0, 0.25, (0, 0.25)), (-1, 7.0, (-1, 1.0))],
)
def test_a_size_is_scaled_up_to_the_seeds_next_to_it(bench, number, amplitude, wanted) -> None:
    effect = bench.effect("actuator_delay", "actuator:drive")
    atom = _atom(effect, effect.seeds[number], slice(0, 1), 4.0, np.array([amplitude]))
    assert atom.values == pytest.approx(effect.seeds[wanted[0]] * wanted[1])


@pytest.mark.parametrize(("number", "amplitude", "gain"), [(0, 0.01, 4.0), (2, 1.0, 4.0), (2, 0.001, 0.0)])
def test_a_seed_far_from_the_size_that_is_wanted_gains_little(bench, number, amplitude, gain) -> None:
    effect = bench.effect("actuator_delay", "actuator:drive")
    assert _atom(effect, effect.seeds[number], slice(0, 1), 4.0, np.array([amplitude])).gain == pytest.approx(gain)


def test_a_place_is_not_scaled(bench) -> None:
    effect = bench.effect("actuator_saturation", "actuator:drive")
    atom = _atom(effect, effect.seeds[3], slice(0, 1), 4.0, np.array([0.5]))
    assert (atom.values == effect.seeds[3]).all()


def test_what_is_fitted_already_gains_nothing_more(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    atoms = screen(bench.shooting, fit, bench.effects).best()
    assert atoms[0].gain < 0.01 * bench.nominal.chi2
    again = next(atom for atom in atoms if atom.effect.name == "viscous_friction")
    assert again.gain < 1.0


def test_together_effects_gain_at_least_what_each_does_and_at_most_the_sum_of_all(screened) -> None:
    first, second = screened.best()[:2]
    assert screened.joint_gain([first]) == pytest.approx(first.gain, rel=1e-6)
    both = screened.joint_gain([first, second])
    assert both >= max(first.gain, second.gain) - 1e-6


def test_an_effect_of_the_wrong_sign_gains_nothing(clean) -> None:
    """Friction that drives is outside the bounds."""
    effect = clean.effect("viscous_friction")
    still = clean.predict(clean.nominal.candidate)
    changed = clean.predict(Candidate((effect,), (np.array([0.02]),))) - still
    seen = dataclasses.replace(clean.segments, position=still - changed)
    (atom,) = screen(dataclasses.replace(clean.shooting, segments=seen), clean.nominal, [effect]).best()
    assert (atom.gain, atom.values[0]) == (0.0, 0.0)


@pytest.mark.parametrize("periods", [20.0, 30.0, 42.0])
def test_a_wave_that_no_list_of_numbers_holds_is_found(clean, periods: float) -> None:
    """The recording itself shows how many periods there are: no seed of the list is near."""
    effect = clean.effect("cogging")
    amount = np.array([0.4, 0.2, periods])
    position = clean.predict(Candidate((effect,), (amount,))) + 1e-5 * np.random.default_rng(0).normal(
        size=clean.segments.position.shape
    )
    seen = dataclasses.replace(clean.segments, position=position)
    atoms = screen(dataclasses.replace(clean.shooting, segments=seen), clean.nominal, [effect]).atoms
    close = 0.6 * 2 * np.pi / np.ptp(position)  # as near as the range tells
    found = [atom.gain for atom in atoms if abs(atom.seed[2] - periods) < close]
    assert np.abs(effect.seeds[:, 2] - periods).min() > close
    assert max(found) > 0.75 * max(atom.gain for atom in atoms)


@pytest.mark.parametrize(("left", "kept"), [(7e-5, 1), (0.2, 2)])
def test_effects_are_independent_where_each_adds_what_the_others_do_not_make_up(screened, left, kept) -> None:
    """The scale of neither matters, nor a third one that has nothing to do with them."""
    along = 30.0 * np.sqrt(1.0 - left)
    normal = np.array([[1.0, along, 0.0], [along, 900.0, 0.0], [0.0, 0.0, 1e-8]])
    atoms = tuple(dataclasses.replace(screened.atoms[i], columns=slice(i, i + 1)) for i in range(3))
    found = Screen(atoms, normal, np.ones(3)).independent(atoms)
    assert found == [*atoms[:kept], atoms[2]]


def test_what_would_need_less_than_nothing_gains_nothing_within_bounds(bench, screened) -> None:
    """The rod hangs in a joint with little damping of its own; with a mirrored gradient it would want much less."""
    damping = next(a for a in screened.best() if a.effect.key == ("viscous_friction", "joint:hip"))
    spring = next(a for a in screened.best() if a.effect.name == "cubic_spring")
    for some in ([damping], [damping, spring]):
        assert screened.possible_gain(some) == pytest.approx(screened.joint_gain(some), rel=1e-6)
    mirrored = dataclasses.replace(screened, gradient=-screened.gradient)
    least = damping.effect.parameters[0].low
    assert mirrored.possible_gain([damping]) < 0.5 * mirrored.joint_gain([damping])
    for factor in (1e-6, 1e12):  # an exact method: the other one of scipy's never ended at a chi2 of 1e9
        much = mirrored.times(factor).possible_gain([damping])
        assert much == pytest.approx(factor * mirrored.possible_gain([damping]), rel=1e-5)
    assert abs(least) < 0.2 * abs(damping.values[0])


def test_what_is_late_by_less_than_nothing_gains_nothing_and_bounds_gain_no_more(bench, screened) -> None:
    late = next(a for a in screened.best() if a.effect.name == "actuator_delay")
    there = np.arange(late.columns.start, late.columns.stop)
    wanted = dataclasses.replace(
        screened, gradient=np.where(np.isin(np.arange(len(screened.gradient)), there), 1.0, 0.0)
    )
    assert wanted.possible_gain([late]) == pytest.approx(wanted.joint_gain([late]))
    assert dataclasses.replace(wanted, gradient=-wanted.gradient).possible_gain([late]) == pytest.approx(0.0, abs=1e-12)
    push = next(a for a in screened.best() if a.effect.name == "constant_force")
    spring = next(a for a in screened.best() if a.effect.name == "cubic_spring")
    index = [push.columns.start, spring.columns.start]
    normal, gradient = np.eye(len(screened.normal)), np.zeros(len(screened.normal))
    normal[np.ix_(index, index)] = [[1.0, 1.0 - 1e-8], [1.0 - 1e-8, 1.0]]
    gradient[index] = 1.0, 1.0 - 1e-4
    alike = Screen(screened.atoms, normal, gradient)
    assert alike.possible_gain([push, spring]) <= alike.joint_gain([push, spring]) * (1.0 + 1e-9)


def test_gains_on_a_part_are_told_as_on_all_data(screened) -> None:
    twice = screened.times(2.0)
    one, two = screened.best()[:2], twice.best()[:2]
    assert [a.gain for a in two] == pytest.approx([2.0 * a.gain for a in one])
    (gain, values), (more, same) = screened.together(one), twice.together(two)
    assert more == pytest.approx(2.0 * gain)
    np.testing.assert_allclose(np.concatenate(same), np.concatenate(values))


def test_what_moves_nothing_gains_nothing(bench) -> None:
    """A centre of mass that moves along the axis of its joint: its column is rounding errors."""
    fit = bench.fit("viscous_friction", 0.05)
    along = next(e for e in bench.effects if e.name == "center_of_mass_offset" and e.variant == "y")
    for base in (bench.nominal, fit):
        (atom,) = screen(bench.shooting, base, [along]).atoms
        assert atom.gain == 0.0


def test_a_vector_with_a_component_that_shows_nowhere_is_no_candidate(bench) -> None:
    forms = {e.variant: e for e in bench.effects if e.name == "center_of_mass_offset"}
    gain = {a.effect.variant: a.gain for a in screen(bench.shooting, bench.nominal, list(forms.values())).atoms}
    assert min(gain["x"], gain["z"], gain["xz"]) > 0.0
    assert gain["xy"] == gain["yz"] == 0.0
