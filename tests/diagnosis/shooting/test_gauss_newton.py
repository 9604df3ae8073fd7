from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.followers import Followers
from torch_activegp.diagnosis.shooting.following import StatesAlone
from torch_activegp.diagnosis.shooting.gauss_newton import Problem
from torch_activegp.diagnosis.simulation.candidate import Candidate


class Steps:
    """A likelihood with a single state."""

    lends = False

    def state_columns(self, starts: np.ndarray) -> np.ndarray:
        return np.array([1e-3])

    def state_reach(self) -> np.ndarray:
        return np.array([1e6])


@pytest.fixture
def line(bench):
    """A straight line through noise-free points: offset as the initial state, slope as the parameter."""
    abscissa = np.linspace(-1.0, 2.0, 12)
    measured = 0.7 + 0.3 * abscissa

    def solve(start: float, hold: bool = False, rounds: int = 6) -> Problem:
        effect = bench.effect("constant_force")
        problem = Problem(Steps(), (effect,), (np.array([start]),), np.zeros((1, 1)), hold)
        for number in range(rounds + 1):
            if problem.finished:
                break
            candidates, states = problem.ask()
            lines = [s[0, 0] + c.values[0][0] * abscissa for c, s in zip(candidates, states, strict=True)]
            problem.tell(measured - np.array(lines)[:, None], last=number == rounds)
        return problem

    return solve


def test_a_linear_problem_is_solved(line) -> None:
    fit = line(5.0).result()
    assert fit.values[0][0] == pytest.approx(0.3, abs=1e-4)
    assert fit.starts[0, 0] == pytest.approx(0.7, abs=1e-4)
    assert fit.chi2 < 1e-6


def test_held_parameters_leave_the_states_free(line) -> None:
    fit = line(5.0, hold=True).result()
    assert fit.values[0][0] == 5.0
    assert fit.starts[0, 0] == pytest.approx(0.7 - (5.0 - 0.3) * 0.5, abs=1e-3)


def test_a_segment_that_is_far_off_begins_again_from_the_recording(bench) -> None:
    nominal, smooth = bench.nominal, bench.nominal.starts + 7.0
    friction = (bench.effect("viscous_friction"),), (np.array([0.05]),)
    problem = Problem(bench.shooting, *friction, nominal.starts, near=nominal, smooth=smooth)
    problem.ask()
    residual = np.ones((1, *nominal.design.shape[:2]))
    residual[0, 1] = 100.0
    problem.tell(residual, last=False)
    _, states = problem.ask()
    np.testing.assert_array_equal(states[0, 1], smooth[1])
    assert (np.abs(np.delete(states[0] - smooth, 1, 0)) > 1.0).any(axis=1).all()


def test_no_point_is_simulated_twice(line, monkeypatch) -> None:
    """Derivatives at a point whose residual is known want only what is moved."""
    asked = []
    ask = Problem.ask

    def listen(self):
        candidates, states = ask(self)
        fresh = zip(candidates[self.known is not None :], states[self.known is not None :], strict=True)
        asked.extend((s[0, 0], c.values[0][0]) for c, s in fresh)
        return candidates, states

    monkeypatch.setattr(Problem, "ask", listen)
    fit = line(5.0).result()
    assert len(set(asked)) == len(asked)
    np.testing.assert_allclose(fit.design, 1.0, rtol=1e-6)
    np.testing.assert_allclose(fit.information, np.var(np.linspace(-1.0, 2.0, 12)) * 12, rtol=1e-6)


@pytest.mark.parametrize("promise", [0.0, 20.0])
def test_states_that_begin_anew_are_tried_also_where_little_is_promised(bench, promise) -> None:
    """A segment that is far off for no reason that its derivatives know of."""
    nominal, smooth = bench.nominal, bench.nominal.starts + 7.0
    friction = (bench.effect("viscous_friction"),), (np.array([0.05]),)
    problem = Problem(bench.shooting, *friction, nominal.starts, near=nominal, smooth=smooth)
    problem.ask()
    basis, _ = np.linalg.qr(nominal.design)
    residual = np.random.default_rng(0).normal(size=nominal.design.shape[:2])
    residual[1] *= 100.0
    residual -= np.einsum("smn,sn->sm", basis, np.einsum("smn,sm->sn", basis, residual))
    residual += np.sqrt(promise / len(basis)) * basis[..., 0]
    problem.tell(residual[None], last=False)
    candidates, states = problem.ask()
    assert len(candidates) == 1
    np.testing.assert_array_equal(states[0, 1], smooth[1])


def test_states_that_promise_little_make_room_for_the_parameters(bench) -> None:
    nominal = bench.nominal
    friction = (bench.effect("viscous_friction"),), (np.array([0.05]),)
    problem = Problem(bench.shooting, *friction, nominal.starts, near=nominal, smooth=nominal.starts)
    problem.ask()
    basis, _ = np.linalg.qr(nominal.design)
    residual = np.random.default_rng(0).normal(size=nominal.design.shape[:2])
    residual -= np.einsum("smn,sn->sm", basis, np.einsum("smn,sm->sn", basis, residual))
    problem.tell(residual[None], last=False)
    candidates, states = problem.ask()
    assert problem.known is not None
    assert [candidate.values[0][0] != 0.05 for candidate in candidates] == [False, True]
    np.testing.assert_array_equal(states[0], nominal.starts)


def test_derivatives_that_were_given_serve_once(bench) -> None:
    best = bench.fit("viscous_friction", 0.02)
    problem = Problem(bench.shooting, best.effects, best.values, best.starts, near=best, smooth=best.starts)
    assert set(problem.derivatives.given) == {0}
    problem.ask()
    problem.tell(bench.shooting.residual_of(best)[None], last=False)
    assert problem.derivatives.given == {}
    assert problem.derivatives.age == 1
    assert problem.finished


def test_a_segment_that_overshot_once_does_not_creep_for_ever(bench) -> None:
    """A full step of the last segment's state leads astray from where it begins, and not from nearer by."""
    abscissa, asked = np.linspace(-1.0, 2.0, 12), 0
    effect = bench.effect("constant_force")
    problem = Problem(Steps(), (effect,), (np.array([5.0]),), np.array([[1.0], [1.0], [1.0], [3.0]]))
    for _ in range(30):
        if problem.finished:
            break
        candidates, states = problem.ask()
        asked += len(candidates) * (1.0 if problem.only is None else problem.only.mean())
        offset = states[..., 0].copy()
        offset[:, 3] = 10.0 * np.arctan(offset[:, 3])
        slope = np.array([c.values[0][0] for c in candidates])
        problem.tell(0.3 * abscissa - offset[..., None] - (slope[:, None] * abscissa)[:, None], last=False)
    fit = problem.result()
    assert fit.chi2 < 1e-2
    assert fit.values[0][0] == pytest.approx(0.3, abs=1e-3)
    assert asked < 40


def test_a_step_that_makes_one_segment_worse_is_tried_again_there_alone(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    problem = Problem(bench.shooting, fit.effects, (np.array([0.02]),), fit.starts)
    for _ in range(2):
        candidates, states = problem.ask()
        assert problem.only is None
        white = bench.shooting.residuals_from(states, candidates)
        if len(candidates) == 1:
            white[0, 3] = 1e6
        problem.tell(white, last=False)
    _, again = problem.ask()
    np.testing.assert_array_equal(np.flatnonzero(problem.only), [3])
    assert len(again) > 1
    assert all(not np.array_equal(one[3], states[0, 3]) for one in again)
    np.testing.assert_array_equal(problem.others, white[0])


def test_states_are_fitted_alone_twice_at_most_from_one_point(bench) -> None:
    """They never follow; from then on, the step gets shorter alone."""
    fit = bench.fit("viscous_friction", 0.05)
    problem = Problem(bench.shooting, fit.effects, (np.array([0.5]),), fit.starts, smooth=fit.starts)
    alone: list[object] = []
    for number in range(30):
        candidates, states = problem.ask()
        derivatives = problem.known is not None or not number
        white = bench.shooting.residuals_from(states, candidates)
        problem.tell(white if derivatives else np.full_like(white, 1e4), last=False)  # only the first point is any good
        alone.append(problem._follower if isinstance(problem._follower, StatesAlone) else None)
    assert len({id(one) for one in alone if one is not None}) == 2


@pytest.mark.parametrize("waits", [True, False])
def test_one_waits_while_states_follow_a_first_step_that_promises_most(bench, waits: bool) -> None:
    begin = bench.fit("viscous_friction", 0.05)
    fit = bench.shooting.fit([(begin.effects, begin.values)], begin.starts)[0]
    value = np.array([0.5]) if waits else fit.values[0] + 1e-3
    problem = Problem(bench.shooting, fit.effects, (value,), fit.starts, smooth=fit.starts)
    seen: list[bool] = []
    for number in range(30):
        candidates, states = problem.ask()
        derivatives = problem.known is not None or not number
        white = bench.shooting.residuals_from(states, candidates)
        problem.tell(white if derivatives else np.full_like(white, 1e4), last=False)
        seen.append(problem.waits)
    assert seen[0] is waits
    assert not seen[-1]  # the step was refused


@pytest.mark.parametrize(("share", "waits"), [(0.75, True), (0.85, False)])
def test_one_waits_behind_a_step_that_helped_much(bench, share: float, waits: bool) -> None:
    """It kept a fifth at least of a promise of nearly all, which the next one may keep."""
    begin = bench.fit("viscous_friction", 0.05)
    fit = bench.shooting.fit([(begin.effects, begin.values)], begin.starts)[0]
    problem = Problem(bench.shooting, fit.effects, (np.array([0.5]),), fit.starts, smooth=fit.starts)
    candidates, states = problem.ask()
    problem.tell(bench.shooting.residuals_from(states, candidates), last=False)
    assert problem.waits
    problem.ask()
    problem.tell(np.sqrt(share) * problem._raw[None], last=False)
    assert problem.waits is waits


def test_where_the_states_have_settled_no_segment_is_braked(bench) -> None:
    """What they could not follow alone they may follow with the parameters."""
    fit = bench.fit("viscous_friction", 0.05)
    starts = fit.starts + 0.01
    problem = Problem(bench.shooting, fit.effects, (np.array([0.02]),), starts, near=fit)
    problem._stale = False  # else its derivatives would be taken anew, which releases all brakes
    braked = []
    while problem._still:
        candidates, states = problem.ask()
        white = bench.shooting.residuals_from(states, candidates)
        problem.tell(white if not braked else white + 100.0, last=False)
        braked.append(problem._brakes.on.any())
    assert any(braked[:-1])
    assert not braked[-1]
    assert problem.only is None


def test_a_step_that_helps_allows_states_to_be_fitted_alone_again(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    problem = Problem(bench.shooting, fit.effects, (np.array([0.02]),), fit.starts)
    problem.tell(bench.shooting.residuals_from(*problem.ask()[::-1]), last=False)
    problem._followers.detours = 0
    problem.tell(bench.shooting.residuals_from(*problem.ask()[::-1]), last=False)
    assert problem._followers.detours == 2


def test_a_fit_whose_steps_keep_nothing_of_their_promises_ends_at_the_third(bench) -> None:
    """Braked segments promise much as long as they do not move, and derivatives anew change nothing about it."""
    fit = bench.fit("viscous_friction", 0.05)
    problem = Problem(bench.shooting, fit.effects, (np.array([0.02]),), fit.starts + 0.01)
    problem.tell(bench.shooting.residuals_from(*problem.ask()[::-1]), last=False)
    trials = 0
    while not problem.finished and trials < 9:
        candidates, states = problem.ask()
        white = bench.shooting.residuals_from(states, candidates)
        if len(candidates) == 1:
            trials += 1
            problem._brakes.damping[:] = 1.0
            problem.tell((1.0 - 1e-6) * problem._raw[None], last=False)
        else:
            problem.tell(problem._raw + white - white[:1], last=False)
    assert trials == 3


def test_a_first_guess_that_is_misled_in_few_segments_gets_states_of_their_own(bench, monkeypatch) -> None:
    """Where a stop is struck in one segment, derivatives without it lead its states nowhere."""
    stop = next(effect for effect in bench.effects if (effect.name, effect.variant) == ("joint_stop", "upper"))
    high = bench.predict(bench.nominal.candidate).max()
    truth = np.array([4000.0, 4.0, 0.97 * high])
    position = bench.predict(Candidate((stop,), (truth,)))
    noise = bench.noise * np.random.default_rng(0).normal(size=position.shape)
    segments = dataclasses.replace(bench.segments, position=position + noise)
    shooting = dataclasses.replace(bench.shooting, segments=segments)
    nominal = shooting.fit([((), ())], bench.nominal.starts)[0]
    guess = [((stop,), (np.array([2000.0, 1.0, 0.965 * high]),))]
    found = shooting.fit(guess, nominal.starts, near=nominal, below=nominal)[0]
    monkeypatch.setattr(Followers, "rescue", lambda *_: None)
    without = shooting.fit(guess, nominal.starts, near=nominal, below=nominal)[0]
    assert nominal.chi2 > 20.0 * shooting.dof
    assert found.chi2 < 1.05 * shooting.dof
    assert found.chi2 < without.chi2 - 10.0
