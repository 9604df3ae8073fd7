from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.screening import Atom, Screen
from torch_activegp.diagnosis.selection.tuning import at_an_optimum, beside, is_a_tuning, only_undoes, paying, undone
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.springs import CenteredSpring

NAMES = ("cubic_spring", "quadratic_drag", "viscous_friction", "armature_error")
PRICE = 9.0


@pytest.fixture
def screened(bench) -> Screen:
    """A spring is missing; damping and rotor were tuned to make up for it, so that both gain nothing alone."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(400, 4))
    columns[:, 0] = columns[:, 2] - 0.8 * columns[:, 3] + 0.3 * columns[:, 0]
    hidden = columns[:, 0] * 4.0
    tuned = columns[:, 2:]
    residual = hidden - tuned @ np.linalg.lstsq(tuned, hidden, rcond=None)[0]
    normal, gradient = columns.T @ columns, columns.T @ residual
    atoms = []
    for i, name in enumerate(NAMES):
        seed = np.array([1.0])
        gain = float(gradient[i] ** 2 / normal[i, i])
        atoms.append(Atom(bench.effect(name), seed, gain, slice(i, i + 1), seed))
    return Screen(tuple(atoms), normal, gradient)


def test_what_hides_behind_a_tuning_shows_beside_it(screened) -> None:
    hidden, _, *tunable = screened.atoms
    assert max(atom.gain for atom in tunable) < 1e-6
    atoms, *rest = beside(screened, PRICE, 0.0, 0.0)
    assert {atom.effect for atom in atoms} == {hidden.effect, *(atom.effect for atom in tunable)}
    worth = screened.joint_gain(atoms) - 2 * PRICE
    assert worth > 2 * hidden.gain
    np.testing.assert_allclose(atoms[0].values, 4.0, rtol=1e-6)
    assert rest == []  # nothing that is tuned pays beside the other one
    assert beside(screened, PRICE, 0.9 * worth, 1.05 * worth)
    assert beside(screened, PRICE, worth, 0.0) == []
    assert beside(screened, PRICE, 0.0, 1.2 * worth) == []


@pytest.mark.parametrize(("share", "asked"), [(0.8, True), (1.5, False)])
def test_what_hides_comes_after_what_explains_more_and_hides_nothing(screened, share: float, asked: bool) -> None:
    """A drag that gains this part of what the spring gains; damping and rotor gain as little beside it as alone."""
    hidden = screened.atoms[0]
    normal, gradient = screened.normal.copy(), screened.gradient + screened.normal[:, 2:] @ np.array([0.2, 0.2])
    worth = beside(dataclasses.replace(screened, gradient=gradient), PRICE, 0.0, 0.0)
    most = screened.joint_gain(worth[0])
    normal[1, :], normal[:, 1] = 0.0, 0.0
    normal[1, 1], gradient[1] = 1.0, np.sqrt(share * most)
    found = beside(dataclasses.replace(screened, normal=normal, gradient=gradient), PRICE, 0.0, 0.0)
    assert [some[0].effect for some in found] == ([hidden.effect] if asked else [])


def test_what_gains_as_much_alone_hides_nothing(screened) -> None:
    """The same, but damping and rotor are off by themselves."""
    gradient = screened.gradient + screened.normal[:, 2:] @ np.array([3.0, -2.0])
    assert beside(dataclasses.replace(screened, gradient=gradient), PRICE, 0.0, 0.0) == []


def test_a_tuned_nominal_stands_at_an_optimum_of_what_was_tuned(screened) -> None:
    def of_the_tunable(gradient: np.ndarray) -> Screen:
        """What a score test of damping and rotor alone finds."""
        atoms = [dataclasses.replace(a, columns=slice(i, i + 1)) for i, a in enumerate(screened.atoms[2:])]
        return Screen(tuple(atoms), screened.normal[2:, 2:], gradient[2:])

    assert at_an_optimum(of_the_tunable(screened.gradient), 1e-3)
    off = of_the_tunable(screened.gradient + screened.normal[:, 2:] @ np.array([0.3, -0.2]))
    gain = off.possible_gain(off.best())
    assert at_an_optimum(off, 1.2 * gain)
    assert not at_an_optimum(off, 1.05 * gain)


def test_only_what_pays_stays(screened) -> None:
    hidden, _, *tunable = screened.atoms
    assert paying(screened, [hidden], tunable, PRICE) == tunable
    assert paying(screened, [hidden], tunable, 1e9) == []
    assert paying(screened, [], tunable, PRICE) == []


def test_of_two_names_for_one_thing_one_pays(screened) -> None:
    """A drive's bias and a constant force on its joint: half of each would seem to be needed."""
    hidden, _, rotor, damping = screened.atoms
    every = [0, 1, 2, 3, 3]
    normal, gradient = screened.normal[np.ix_(every, every)], screened.gradient[every]
    twin = dataclasses.replace(damping, columns=slice(4, 5))
    both = Screen((*screened.atoms, twin), normal, gradient)
    assert paying(both, [hidden], [rotor, damping, twin], PRICE) == [rotor, damping]


def test_what_is_undone_comes_on_top_of_a_set(bench) -> None:
    fit = bench.fit("cubic_spring", 0.1)
    atom = Atom(bench.effect("viscous_friction"), np.array([0.06]), 50.0, slice(0, 1), np.array([0.06]))
    found = Screen((atom,), np.array([[50.0]]), np.array([50.0]))
    ((effects, values),) = undone(fit, found, PRICE)
    assert effects == (*fit.effects, atom.effect)
    np.testing.assert_allclose(values[-1], 0.06)
    assert undone(fit, found, 100.0) == []
    drag = dataclasses.replace(atom, effect=bench.effect("quadratic_drag"))
    assert undone(fit, dataclasses.replace(found, atoms=(drag,)), PRICE) == []  # which nobody tunes


def test_a_tuning_gains_less_alone_than_beside_what_it_hides(bench) -> None:
    def fit(chi2: float, count: int = 1, damping: float = 0.1):
        effects, values = (bench.effect("viscous_friction"),) * count, (np.array([damping]),) * count
        return dataclasses.replace(bench.nominal, chi2=chi2, effects=effects, values=values)

    nominal, best = fit(1000.0), fit(0.0)
    assert only_undoes(nominal, fit(960.0), fit(300.0), best)
    assert not only_undoes(nominal, fit(950.0), fit(300.0), best)
    assert only_undoes(nominal, fit(860.0), fit(1000.0), best)
    assert not only_undoes(nominal, fit(840.0), fit(5000.0), best)
    assert only_undoes(nominal, fit(900.0, count=2), fit(300.0), best)
    assert not only_undoes(nominal, fit(850.0, count=2), fit(300.0), best)
    assert only_undoes(nominal, fit(650.0, count=4), fit(300.0), best, needed=True)
    assert not only_undoes(nominal, fit(650.0, count=3), fit(300.0), best, needed=True)
    assert only_undoes(nominal, fit(530.0, count=4), fit(300.0), best, needed=True)
    assert not only_undoes(nominal, fit(510.0, count=4), fit(300.0), best, needed=True)
    assert not only_undoes(nominal, fit(650.0, count=4), fit(300.0), best)
    assert not only_undoes(nominal, fit(100.0), fit(300.0), best)
    assert only_undoes(nominal, fit(800.0, count=3), fit(300.0), best)
    assert not only_undoes(nominal, fit(100.0, count=3), fit(300.0), best)
    assert only_undoes(nominal, fit(700.0), fit(300.0), fit(0.0, damping=-0.1))  # a damping that drives


@pytest.mark.parametrize(
    ("name", "damping", "others", "undoes"),
    [
        ("viscous_friction", -0.1, (), True),
        ("viscous_friction", 0.1, (), False),
        ("quadratic_drag", -0.1, (), False),  # nobody tunes it
        ("viscous_friction", -0.1, ("joint:knee",), False),  # of another joint it says nothing
    ],
)
def test_a_damping_below_zero_says_that_its_joint_was_tuned(bench, name: str, damping: float, others, undoes) -> None:
    wet, gain = bench.effect(name), bench.effect("actuator_gain", "actuator:drive")
    assert gain.acts_on == wet.acts_on
    tunable = (wet, *(dataclasses.replace(bench.effect("armature_error"), target=target) for target in others))
    values = (np.array([damping]),) * len(tunable)
    best = dataclasses.replace(bench.nominal, chi2=0.0, effects=tunable, values=values)
    alone, nominal, without = (dataclasses.replace(best, chi2=chi2) for chi2 in (300.0, 1000.0, 700.0))
    assert only_undoes(nominal, alone, without, best) is undoes


def test_a_damping_below_zero_is_no_evidence_where_it_does_not_undo_anything(bench) -> None:
    wet, gain = bench.effect("viscous_friction"), bench.effect("actuator_gain", "actuator:drive")
    best = dataclasses.replace(bench.nominal, chi2=0.0, effects=(wet, gain), values=(np.array([-0.1]), np.array([1.1])))
    alone = dataclasses.replace(best, chi2=300.0, effects=(gain,), values=(np.array([1.1]),))
    nominal, without = (dataclasses.replace(bench.nominal, chi2=chi2) for chi2 in (1000.0, 700.0))
    assert not only_undoes(nominal, alone, without, best)


@pytest.mark.parametrize("tuned", [True, False])
def test_a_nominal_far_from_one_optimum_was_not_tuned(bench, monkeypatch, tuned: bool) -> None:
    """A damping is missing, or was tuned; what few corrections beside it undo is a tuning in the second case alone."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: True)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.fitted", lambda *_: bench.nominal)
    damping, rotor = bench.effect("viscous_friction"), bench.effect("armature_error")
    found = bench.fit("viscous_friction", bench.viscous)
    nominal = found if tuned else bench.nominal
    best = dataclasses.replace(found, chi2=0.5 * found.chi2)
    selection = Selection(nominal, [nominal, best], Score(bench.shooting.samples, 60, 1.0), tunable=(damping, rotor))
    assert is_a_tuning(bench.shooting, selection, [rotor], [damping]) is tuned
    assert is_a_tuning(bench.shooting, selection, [rotor] * 4, [damping])  # so many corrections are one anyway


@pytest.mark.parametrize(("together", "tuned"), [(0.2, True), (0.4, False)])
def test_one_correction_undoes_a_tuning_where_the_others_were_at_their_best(
    bench, monkeypatch, together: float, tuned: bool
) -> None:
    """One thing that was tuned alone, with others far from where they fit, is what is missing."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: True)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.fitted", lambda *_: bench.nominal)
    damping, rotor = bench.effect("viscous_friction"), bench.effect("armature_error")
    best = dataclasses.replace(bench.fit("viscous_friction", bench.viscous), chi2=bench.nominal.chi2 - 1000.0)
    selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.0))
    selection.tunable_gains = {rotor: 100.0}, 1000.0 * together
    assert is_a_tuning(bench.shooting, selection, [rotor], [damping]) is tuned
    assert is_a_tuning(bench.shooting, selection, [rotor, rotor], [damping])


@pytest.mark.parametrize(
    ("count", "where", "tuned"), [(2, "joint:knee", False), (3, "joint:knee", True), (3, "", False)]
)
def test_three_corrections_say_which_joints_were_tuned(bench, monkeypatch, count: int, where: str, tuned: bool) -> None:
    """What a joint lacks that none of them acts on was left as it was."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: True)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.fitted", lambda *_: bench.nominal)
    drag, rotor = bench.effect("quadratic_drag"), bench.effect("armature_error")
    gain = bench.effect("actuator_gain", "actuator:drive")
    assert gain.drives == rotor.target
    best = dataclasses.replace(bench.fit("quadratic_drag", 0.01), chi2=bench.nominal.chi2 - 1000.0)
    selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.0))
    selection.tunable_gains = {dataclasses.replace(rotor, target=where or rotor.target): 600.0}, 900.0
    assert is_a_tuning(bench.shooting, selection, [gain, rotor, rotor][:count], [drag]) is tuned


@pytest.mark.parametrize(("count", "needed", "left", "tuned"), [
    (4, True, 1.05, True), (3, True, 1.05, False), (4, False, 1.05, False), (4, True, 1.2, False),
])  # fmt: skip
@pytest.mark.parametrize("alone", [0.0, 0.6])
def test_many_corrections_that_no_few_names_make_up_for_are_a_tuning(
    bench, monkeypatch, count: int, needed: bool, left: float, tuned: bool, alone: float
) -> None:
    """But where one that is tunable gains much `alone`: who had tuned would have found it."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: False)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.fitted", lambda *_: bench.nominal)
    damping, rotor = bench.effect("viscous_friction"), bench.effect("armature_error")
    best = dataclasses.replace(bench.fit("viscous_friction", bench.viscous), chi2=left * bench.shooting.dof)
    selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.0))
    explained = bench.nominal.chi2 - best.chi2
    selection.tunable_gains = {rotor: alone * explained}, alone * explained
    assert is_a_tuning(bench.shooting, selection, [rotor] * count, [damping], needed) is (tuned and alone == 0.0)


@pytest.mark.parametrize(("together", "tuned"), [(0.2, True), (0.4, False)])
def test_where_a_spring_rests_is_no_correction_of_its_own(bench, monkeypatch, together: float, tuned: bool) -> None:
    """With it, one correction would be two, of which less is asked."""
    seen = []
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: True)
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.tuning.fitted", lambda _, __, some: seen.append(list(some)) or bench.nominal
    )
    spring = next(e for e in bench.effects if isinstance(e, CenteredSpring) and e.name == "linear_spring")
    rotor, push = bench.effect("armature_error"), bench.effect("constant_force")
    best = dataclasses.replace(bench.fit("viscous_friction", bench.viscous), chi2=bench.nominal.chi2 - 1000.0)
    selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.0))
    selection.tunable_gains = {rotor: 100.0}, 1000.0 * together
    assert is_a_tuning(bench.shooting, selection, [rotor, push], [spring]) is tuned
    assert seen == ([[rotor], [spring, push]] if tuned else [])
    assert is_a_tuning(bench.shooting, selection, [push], [spring]) is tuned  # nothing else was tuned
    assert is_a_tuning(bench.shooting, selection, [rotor, push], [bench.effect("viscous_friction")])


@pytest.mark.parametrize(
    ("left", "count", "behind", "tuned"),
    [(1.0, 3, 120.0, True), (1.2, 3, 120.0, False), (1.0, 2, 120.0, False), (1.0, 3, 90.0, False)],
)
def test_corrections_that_fit_clearly_better_than_names_undo_a_tuning(
    bench, monkeypatch, left: float, count: int, behind: float, tuned: bool
) -> None:
    """Down to the noise, and three of them at least; a set of many corrections is none of names."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: False)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.fitted", lambda *_: bench.nominal)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning._was_not_tuned", lambda *_: False)
    drag, spring = bench.effect("quadratic_drag"), bench.effect("linear_spring")
    wet, rotor = bench.effect("viscous_friction"), bench.effect("armature_error")
    gain = bench.effect("actuator_gain", "actuator:drive")
    corrections = [wet, rotor, gain][:count]
    chi2 = left * bench.shooting.dof

    def fit(effects, above: float = 0.0):
        values = tuple(np.zeros(len(effect.parameters)) for effect in effects)
        return dataclasses.replace(bench.nominal, effects=tuple(effects), values=values, chi2=chi2 + above)

    best, names = fit([drag, *corrections]), fit([drag, spring], behind)
    dearer = fit([drag, spring, *corrections], 1.0)
    score = Score(bench.shooting.samples, 5, 1.0, free=frozenset(effect.key for effect in corrections))
    selection = Selection(fit([], 1e6), [fit([], 1e6), best, names, dearer], score)
    assert selection.best is best
    assert is_a_tuning(bench.shooting, selection, corrections, [drag]) is tuned
    selection.fits = [*selection.fits[:2], fit([spring], 500.0)]  # as few names
    assert not is_a_tuning(bench.shooting, selection, corrections, [drag])


@pytest.mark.parametrize("count", [3, 4])
def test_of_many_corrections_that_fit_clearly_better_than_names_one_may_gain_much_alone(
    bench, monkeypatch, count: int
) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning._was_not_tuned", lambda *_: True)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning._is_better_than_names", lambda *_: True)
    rotor, drag = bench.effect("armature_error"), bench.effect("quadratic_drag")
    best = dataclasses.replace(bench.fit("armature_error", 0.0), chi2=bench.shooting.dof)
    selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.0))
    assert is_a_tuning(bench.shooting, selection, [rotor] * count, [drag], needed=True) is (count == 4)
