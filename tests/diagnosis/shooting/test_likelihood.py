from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.shooting import likelihood as shooting
from torch_activegp.diagnosis.shooting.advance import advance
from torch_activegp.diagnosis.shooting.gauss_newton import SETTLE, Problem
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.race import Race
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

STOP = np.array([0.3, 20.0, 0.2])


def test_the_noise_alone_is_left_where_the_model_is_right(clean) -> None:
    assert clean.nominal.chi2 / clean.shooting.dof == pytest.approx(1.0, abs=0.2)
    assert clean.shooting.samples == clean.segments.counts.sum()
    assert clean.shooting.dof == clean.shooting.samples - 2 * clean.segments.size
    assert clean.nominal.per_segment.sum() == pytest.approx(clean.nominal.chi2)


@pytest.mark.parametrize(("rate", "hidden"), [(70.0, False), (60.0, True)])
def test_below_67_hz_nobody_sees_a_filter(clean, rate: float, hidden: bool) -> None:
    segments = dataclasses.replace(clean.segments, dt=np.full_like(clean.segments.dt, 1.0 / rate))
    assert dataclasses.replace(clean.shooting, segments=segments).hides_colour is hidden


def test_a_fit_finds_the_parameter_from_afar(bench) -> None:
    fit = bench.fit("viscous_friction", 1.0)
    assert fit.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    assert fit.chi2 / bench.shooting.dof == pytest.approx(1.0, abs=0.2)
    assert (fit.size, fit.keys) == (1, {("viscous_friction", "joint:hip")})


def test_fits_side_by_side_equal_fits_alone(bench) -> None:
    sets = [
        ((bench.effect(name),), (np.array([0.02]),))
        for name in ("viscous_friction", "quadratic_drag", "armature_error")
    ]
    together = bench.shooting.fit(sets, bench.nominal.starts)
    for one, fit in zip(sets, together, strict=True):
        alone = bench.shooting.fit([one], bench.nominal.starts)[0]
        assert alone.chi2 == fit.chi2
        np.testing.assert_array_equal(alone.values[0], fit.values[0])


@pytest.mark.parametrize(("hold", "size"), [(False, 1), (True, 0)])
def test_nothing_is_known_of_parameters_that_had_no_time_to_move(bench, hold: bool, size: int) -> None:
    wet = bench.effect("viscous_friction")
    sets, near = [((wet,), (np.array([0.02]),))], bench.nominal
    fit = bench.shooting.fit(sets, near.starts, rounds=0, near=near, hold=hold)[0]
    assert fit.information.shape == (size, size)
    assert fit.scores.shape == (bench.segments.size, size)
    assert not fit.information.any()
    assert not fit.scores.any()


def test_the_optimum_is_stationary_and_its_curvature_the_information(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    step = 0.004

    def profile(value: float) -> float:
        sets = [(fit.effects, (np.array([value]),))]
        return bench.shooting.fit(sets, fit.starts, hold=True)[0].chi2

    low, middle, high = (profile(fit.values[0][0] + k * step) for k in (-1, 0, 1))
    assert middle == pytest.approx(fit.chi2, abs=0.1)
    assert (high - 2 * middle + low) / (2 * step**2) == pytest.approx(fit.information[0, 0], rel=0.1)
    assert abs(high - low) / (high + low - 2 * middle) < 0.2


def test_hold_keeps_the_parameters(bench) -> None:
    effect = bench.effect("viscous_friction")
    held = bench.shooting.fit([((effect,), (np.array([0.3]),))], bench.nominal.starts, hold=True)[0]
    assert held.values[0] == [0.3]
    assert held.chi2 > bench.nominal.chi2


def test_a_parameter_stays_within_its_bounds(bench) -> None:
    effect = bench.effect("viscous_friction")
    narrow = dataclasses.replace(effect, parameters=(dataclasses.replace(effect.parameters[0], high=0.04),))
    fit = bench.shooting.fit([((narrow,), (np.array([0.01]),))], bench.nominal.starts)[0]
    assert fit.values[0][0] == 0.04


def test_a_coarse_engine_with_its_error_taken_out_stands_for_a_precise_one(bench) -> None:
    euler = int(mujoco.mjtIntegrator.mjINT_EULER)
    coarse = Engine(bench.engine.model, bench.engine.channels, 1, 1, euler)
    rough = dataclasses.replace(bench.shooting, engine=coarse)
    precise = bench.fit("viscous_friction", 0.05)
    wrong = rough.fit([(precise.effects, precise.values)], precise.starts)[0]
    right = rough.corrected(bench.engine, precise).fit([(precise.effects, precise.values)], precise.starts)[0]
    assert abs(right.values[0][0] - precise.values[0][0]) < 0.2 * abs(wrong.values[0][0] - precise.values[0][0])
    assert right.chi2 == pytest.approx(precise.chi2, rel=0.02)
    assert bench.shooting.corrected(bench.engine, precise).offset is None


def test_a_subset_is_a_likelihood_of_its_own(bench) -> None:
    shooting = Shooting(bench.engine, bench.segments, bench.shooting.noise, np.zeros_like(bench.segments.position))
    part, which = shooting.subset(0.1)
    assert len(which) == part.segments.size == 6
    assert part.offset.shape == part.segments.position.shape
    fit = part.fit([((), ())], bench.nominal.starts[which])[0]
    np.testing.assert_allclose(fit.per_segment, bench.nominal.per_segment[which], rtol=0.01)


def test_a_subset_holds_the_worst_segments_and_no_segment_twice(bench) -> None:
    first = np.arange(bench.segments.size, dtype=float)[::-1]
    part, which = bench.shooting.subset(0.8, first)
    count = int(np.ceil(0.8 * bench.segments.size))
    assert len(set(which)) == part.segments.size == count
    assert set(range(count // 2)) <= set(which)
    for share in (1.0, 3.0):
        whole, every = bench.shooting.subset(share, first)
        assert whole.segments.size == bench.segments.size == len(set(every))


def test_a_hopeless_set_is_given_up_in_a_race(bench) -> None:
    names = (
        "viscous_friction",
        "quadratic_drag",
        "coulomb_friction",
        "linear_spring",
        "constant_force",
        "cubic_spring",
    )
    sets = [((bench.effect(name),), (np.array([0.02]),)) for name in names]
    fits = bench.shooting.fit(sets, bench.nominal.starts, race=Race())
    best = min(fits, key=lambda fit: fit.chi2)
    assert best.keys == {("viscous_friction", "joint:hip")}
    assert best.chi2 == pytest.approx(bench.fit("viscous_friction", 0.02).chi2, abs=0.2)


def test_those_whose_guess_did_not_mislead_race_from_the_second_step_on(bench, monkeypatch) -> None:
    flags: list[bool] = []
    monkeypatch.setattr(Race, "give_up", lambda self, problems, ended, only_misled: flags.append(only_misled))
    wet = (bench.effect("viscous_friction"),), (np.array([0.3]),)
    bench.shooting.fit([wet], bench.nominal.starts, race=Race(), near=bench.nominal)
    assert flags[:6] == [True] * 6
    assert len(flags) > 6
    assert not any(flags[6:])


def test_a_first_guess_that_makes_it_worse_is_left_for_the_smaller_set(bench) -> None:
    """A rotor guessed far too heavy, in segments whose states were fitted without it."""
    effects, guess = (bench.effect("viscous_friction"), bench.effect("armature_error")), 30.0
    below = bench.fit("viscous_friction", 0.02)
    some = [(effects, (below.values[0], np.array([guess])))]
    (led,) = bench.shooting.fit(some, below.starts, near=below, rounds=8)
    (left,) = bench.shooting.fit(some, below.starts, near=below, rounds=8, below=below)
    assert left.chi2 <= below.chi2 < led.chi2


def test_a_set_that_a_guess_misled_is_not_tried_anew_far_behind_in_a_race(bench) -> None:
    (wet,), (wetness,) = (known := bench.fit("viscous_friction", 0.02)).effects, known.values
    ahead = [((wet, bench.effect(name)), (wetness, np.zeros(1))) for name in ("constant_force", "quadratic_drag")]
    misled = (bench.effect("armature_error"),), (np.array([30.0]),)
    sets = [((wet,), (wetness,)), *ahead, misled]
    fits = bench.shooting.fit(sets, bench.nominal.starts, race=Race(), near=bench.nominal, below=bench.nominal)
    assert fits[3].values[0].tolist() == [0.0]
    assert fits[3].chi2 == bench.nominal.chi2 > 2.0 * fits[2].chi2
    alone = bench.shooting.fit(sets[3:], bench.nominal.starts, race=Race(), near=bench.nominal, below=bench.nominal)
    assert alone[0].chi2 < bench.nominal.chi2


def count_simulations(monkeypatch) -> list[int]:
    asked = []
    predict = Engine.predict

    def listen(self, segments, starts, candidates):
        asked.append(len(candidates))
        return predict(self, segments, starts, candidates)

    monkeypatch.setattr(Engine, "predict", listen)
    return asked


def test_derivatives_of_a_smaller_set_serve_a_larger_one(bench, monkeypatch) -> None:
    below = bench.fit("viscous_friction", 0.02)
    assert below.columns is not None
    larger = (below.effects[0], bench.effect("quadratic_drag")), (below.values[0], np.array([1e-3]))
    (plain,) = bench.shooting.fit([larger], below.starts, near=dataclasses.replace(below, columns=None))
    asked = count_simulations(monkeypatch)
    (fit,) = bench.shooting.fit([larger], below.starts, near=below)
    assert max(asked) == 1
    assert fit.chi2 == pytest.approx(plain.chi2, abs=0.1)
    np.testing.assert_allclose(fit.values[1], plain.values[1], atol=0.1 * below.information[0, 0] ** -0.5)


def test_a_set_whose_derivatives_are_all_known_steps_at_once(bench, monkeypatch) -> None:
    best = bench.fit("viscous_friction", 0.02)
    off = [((best.effects[0],), (1.05 * best.values[0],))]
    asked = count_simulations(monkeypatch)
    (fit,) = bench.shooting.fit(off, best.starts, near=best)
    assert set(asked) == {1}
    assert fit.chi2 == pytest.approx(best.chi2, abs=0.1)


def test_a_correction_by_what_is_known_needs_no_precise_simulation(bench, monkeypatch) -> None:
    precise = Engine(bench.machine.model, bench.engine.channels, 8, 1)
    asked = bench.shooting.corrected(precise, bench.nominal)
    exact = dataclasses.replace(bench.shooting, engine=precise).predicted(bench.nominal)
    monkeypatch.setattr(precise, "predict", None)
    told = bench.shooting.corrected(precise, bench.nominal, exact)
    assert told.offset is not None and np.abs(told.offset).max() > 0.0
    np.testing.assert_array_equal(told.offset, asked.offset)


@pytest.fixture
def sticking(clean):
    """Fits Stribeck friction, from far off and in so many rounds, to a joint that sticks and slips."""
    effect, values = clean.effect("stribeck_friction"), np.array([0.5, 0.3, 0.4])
    engine = Engine(clean.machine.model, clean.engine.channels, 8, 1, late=True)
    truth = engine.predict(clean.segments, clean.nominal.starts[None], [Candidate((effect,), (values,))])[0]
    noise = clean.noise * np.random.default_rng(0).normal(size=truth.shape)
    segments = dataclasses.replace(clean.segments, position=truth + noise)
    shooting = Shooting(engine, segments, clean.shooting.noise)
    nominal = shooting.fit([((), ())], engine.starts(segments), rounds=6)[0]
    assert nominal.chi2 > 100 * shooting.dof
    begin = [((effect,), (np.array([0.75, 0.09, 0.5]),))]
    return lambda **how: (shooting.fit(begin, nominal.starts, near=nominal, **how)[0], shooting.dof)


def test_a_joint_that_sticks_and_slips_lets_parameters_go_far(sticking) -> None:
    """A step of the parameters is judged once the states have followed: what stuck before it slips after it."""
    fit, dof = sticking()
    assert fit.chi2 < 2 * dof
    assert fit.values[0][0] == pytest.approx(0.5, rel=0.02)


def test_a_fit_may_end_in_any_round_and_never_gets_worse(sticking) -> None:
    """Also while the states follow a step that may yet be refused."""
    fits = [sticking(rounds=rounds)[0] for rounds in range(5, 18)]
    assert all(np.diff([fit.chi2 for fit in fits]) <= 0.0)
    assert all(fit.information.shape == (3, 3) and fit.scores.shape[1] == 3 for fit in fits)
    assert all(fit.per_segment.sum() == pytest.approx(fit.chi2) for fit in fits)


@pytest.mark.parametrize("hold", [False, True])
def test_what_is_tried_in_a_part_of_the_segments_is_simulated_there_alone(bench, monkeypatch, hold) -> None:
    """And the fit is the same as where everything is simulated."""
    sets = [((bench.effect("coulomb_friction"),), (np.array([0.3]),)), ((bench.effect("joint_stop"),), (STOP,))]
    right, starts = bench.fit("viscous_friction", 0.05), bench.nominal.starts.copy()
    if hold:
        sets, starts = [(right.effects, right.values)], right.starts.copy()
        starts[2, 1] += 3.0  # restless, where the others have settled
    asked: list[int] = []
    predict = Engine.predict

    def listen(self, segments, starts, candidates):
        asked.append(segments.size)
        return predict(self, segments, starts, candidates)

    monkeypatch.setattr(Engine, "predict", listen)
    partly = bench.shooting.fit(sets, starts, hold=hold, near=right if hold else None)
    least = min(asked)
    asked.clear()
    ask = Problem.ask

    def of_all(self):
        wanted = ask(self)
        self.only = None
        return wanted

    monkeypatch.setattr(Problem, "ask", of_all)
    wholly = bench.shooting.fit(sets, starts, hold=hold, near=right if hold else None)
    assert least < min(asked) == bench.segments.size
    for one, other in zip(partly, wholly, strict=True):
        assert one.chi2 == pytest.approx(other.chi2, rel=1e-9)
        np.testing.assert_allclose(one.starts, other.starts, rtol=1e-6, atol=1e-9)


def test_held_parameters_leave_segments_that_have_settled_alone(bench, monkeypatch) -> None:
    starts = bench.nominal.starts.copy()
    starts[2, 1] += 3.0
    trials: list[np.ndarray] = []
    advance = Problem.tell

    def listen(self, white, last):
        trials.append(self.only)
        if self.only is not None:
            np.testing.assert_array_equal(self._trial_starts[~self.only], self.best.starts[~self.only])
        advance(self, white, last)

    monkeypatch.setattr(Problem, "tell", listen)
    again = bench.shooting.fit([((), ())], starts, near=bench.nominal)[0]
    partly = [only for only in trials if only is not None]
    assert partly
    assert all(only[2] for only in partly[:1])
    assert sum(only.sum() for only in partly) < 0.5 * len(partly) * bench.segments.size
    assert again.chi2 == pytest.approx(bench.nominal.chi2, abs=1.0)


@pytest.mark.parametrize("soon", range(1, 9))
def test_a_fit_that_ends_far_off_has_its_derivatives(sticking, monkeypatch, soon: int) -> None:
    """In whatever round: also where the states are following a step, or all derivatives are to be taken anew."""
    monkeypatch.setattr("torch_activegp.diagnosis.shooting.likelihood._SOON", soon)
    monkeypatch.setattr("torch_activegp.diagnosis.shooting.likelihood._FAR_OFF", 0.0)
    assert sticking()[0].design is not None


def test_a_race_ends_where_it_is_once_so_much_is_computed(bench, monkeypatch) -> None:
    """What it has found by then is told; without a race fits go on."""
    sets = [((bench.effect("joint_stop"),), (np.array([30.0, 0.5, 0.2]),))]
    rounds: list[int] = []
    monkeypatch.setattr(shooting, "advance", lambda *a, **k: rounds.append(1) or advance(*a, **k))
    counts = []
    for race, work in ((None, np.inf), (Race(), np.inf), (Race(), bench.shooting.work)):
        rounds.clear()
        (fit,) = bench.shooting.fit(sets, bench.nominal.starts, race=race, work=work)
        assert np.isfinite(fit.chi2)
        counts.append(len(rounds))
        assert fit.information.any()  # it ends whole, with its derivatives
    assert counts[0] == counts[1] > counts[2] == SETTLE + 4


def test_fits_end_where_so_much_is_computed_in_all(bench, monkeypatch) -> None:
    """After a few rounds in any case: a first guess alone is no fit."""
    asked = count_simulations(monkeypatch)
    sets = [((bench.effect("coulomb_friction"),), (np.array([0.3]),))]
    bench.shooting.fit(sets, bench.nominal.starts)
    whole = len(asked)
    asked.clear()
    bench.shooting.fit(sets, bench.nominal.starts, work=bench.shooting.work)
    assert 3 < len(asked) < whole
