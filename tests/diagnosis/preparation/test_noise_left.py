from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, lfilter

from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel, colour_scale, high_differences
from torch_activegp.diagnosis.preparation import noise_left
from torch_activegp.diagnosis.preparation.noise_left import by_segment, noise_behind, raised, recoloured, rises
from torch_activegp.diagnosis.selection.omnibus import omnibus
from torch_activegp.diagnosis.simulation.candidate import NOMINAL


def bench_exact(bench) -> np.ndarray:
    """What the perfect model's sensors would read."""
    return bench.engine.predict(bench.segments, bench.nominal.starts[None], [NOMINAL])[0]


def with_noise(bench, level: float, scale: float, pole: float = 0.0):
    """The likelihood and the fit of a perfect model whose noise is said to be of some level."""
    rng = np.random.default_rng(3)
    exact = bench_exact(bench)
    fresh = rng.normal(size=(exact.shape[0], 200 + exact.shape[1], exact.shape[2]))
    coloured = lfilter([np.sqrt(1 - pole**2)], [1, -pole], fresh, axis=1)[:, 200:]
    segments = dataclasses.replace(bench.segments, position=exact + scale * coloured)
    shooting = dataclasses.replace(bench.shooting, segments=segments, noise=NoiseModel.white(np.array([level])))
    return shooting, shooting.fit([((), ())], bench.nominal.starts)[0]


@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_noise_that_was_thought_too_loud_is_seen(clean, pole) -> None:
    shooting, fit = with_noise(clean, 1e-2, 1e-3, pole)
    found = noise_behind(shooting, fit)
    assert found is not None
    assert found.innovation[0] == pytest.approx(1e-3 * np.sqrt(1 - pole**2), rel=0.12)
    assert found.colour.any() == (pole > 0.0)
    again = dataclasses.replace(shooting, noise=found)
    assert noise_behind(again, again.fit([((), ())], fit.starts)[0]) is None


@pytest.mark.parametrize("level", [1e-3, 3e-4])
def test_noise_is_never_made_louder(clean, level) -> None:
    shooting, fit = with_noise(clean, level, 1e-3)
    assert noise_behind(shooting, fit) is None


def test_too_few_values_and_failed_simulations_say_nothing(clean) -> None:
    shooting, fit = with_noise(clean, 1e-2, 1e-3)
    few = shooting.pick(np.arange(2))
    assert noise_behind(few, fit.pick(np.arange(2))) is None
    assert noise_behind(shooting, dataclasses.replace(fit, starts=fit.starts * np.nan)) is None


@pytest.mark.parametrize(("level", "seen"), [(1e-2, True), (3e-4, False)])
def test_far_below_the_floor_the_closest_colour_stands_in_for_what_is_left_of_physics(clean, level, seen: bool) -> None:
    """A slow error, white behind no filter, beside noise of 1e-4: less than the error, no less than the noise."""
    shooting, fit = with_noise(clean, level, 1e-4)
    time = np.arange(shooting.segments.intervals + 1) / 100
    slow = 3e-3 * np.sin(2 * np.pi * 6.0 * time)[None, :, None]
    segments = dataclasses.replace(shooting.segments, position=shooting.segments.position + slow)
    bent = dataclasses.replace(shooting, segments=segments)
    found = noise_behind(bent, fit)
    assert (found is not None) == seen
    assert found is None or 1e-4 < found.innovation[0] < 1e-3
    assert noise_behind(bent, fit, last=True) is None


@pytest.mark.parametrize(("floor", "seen"), [(1.5e-4, True), (1.1e-4, False)])
def test_a_motion_that_was_taken_for_a_colour_is_seen_behind_what_is_weak(clean, floor: float, seen: bool) -> None:
    """Behind a floor of two poles, as of a tight loop, an error of ten times the noise leaves 0.35 of it; or 0.65."""
    shooting, fit = with_noise(clean, 1e-3, 6e-5)
    time = np.arange(shooting.segments.intervals + 1) / 100
    weak = 6e-4 * np.sin(2 * np.pi * 1.0 * time)[None, :, None]
    segments = dataclasses.replace(shooting.segments, position=shooting.segments.position + weak)
    poles = (1.88, -0.8836)
    slow = NoiseModel(np.array([floor / colour_scale(poles)]), np.array([poles]))
    found = noise_behind(dataclasses.replace(shooting, segments=segments, noise=slow), fit)
    assert (found is not None) == seen
    assert found is None or 5e-5 < found.innovation[0] < 1.6e-4


@pytest.mark.parametrize(("order", "corner"), [(1, 5.0), (1, 10.0), (2, 10.0)])
def test_behind_a_filter_that_no_colour_is_a_perfect_model_stays_one(clean, order: int, corner: float) -> None:
    """Butterworth's: what is left is no noise of the family, and no physics either."""
    shooting, fit = with_noise(clean, 1e-3, 1e-3)
    rng = np.random.default_rng(5)
    slow = lfilter(*butter(order, corner, fs=100), rng.normal(size=(len(fit.starts), 800)), axis=1)[:, -200:]
    exact = bench_exact(clean)
    count = exact.shape[1]
    position = exact + 1e-3 * (slow / slow.std())[:, :count, None]
    filtered = dataclasses.replace(shooting, segments=dataclasses.replace(shooting.segments, position=position))
    poles, error = (2 * 0.88, -(0.88**2)), position - exact
    fresh = (error[:, 2:] - poles[0] * error[:, 1:-1] - poles[1] * error[:, :-2]).std()  # as its spectrum shows it
    floor = dataclasses.replace(filtered, noise=NoiseModel(np.array([fresh / colour_scale(poles)]), np.array([poles])))
    found = noise_behind(floor, floor.fit([((), ())], fit.starts)[0])
    again = dataclasses.replace(floor, noise=found or floor.noise)
    assert again.fit([((), ())], fit.starts)[0].chi2 < 1.2 * again.dof


@pytest.mark.parametrize(("floor", "louder"), [(1e-2, True), (3e-4, False), (8e-4, False)])
def test_noise_that_was_taken_too_low_rises_again_below_the_floor(clean, floor, louder: bool) -> None:
    shooting, fit = with_noise(clean, 3e-4, 1e-3, 0.7)
    found = noise_behind(shooting, fit, NoiseModel.white(np.array([floor])))
    assert (found is not None) == louder
    if found is not None:
        assert found.innovation[0] == pytest.approx(1e-3 * np.sqrt(1 - 0.7**2), rel=0.12)


def test_noise_is_not_below_what_rigid_bodies_hold(clean) -> None:
    shooting, fit = with_noise(clean, 1e-2, 1e-9)
    spread = np.sqrt(np.mean([run.position.var(axis=0) for run in shooting.segments.runs], axis=0))
    found = noise_behind(shooting, fit)
    assert found is not None
    assert found.innovation[0] == pytest.approx(3e-5 * spread[0], rel=1e-6)
    again = dataclasses.replace(shooting, noise=found)
    assert noise_behind(again, fit) is None


@pytest.mark.parametrize("pole", [0.55, 0.7, 0.88])
def test_a_filter_that_the_floor_did_not_see_is_seen_behind_a_perfect_model(clean, pole: float) -> None:
    floor = 1e-3 * np.sqrt((1 - pole**2) * high_differences((pole, 0.0)))
    shooting, fit = with_noise(clean, floor, 1e-3, pole)
    assert fit.chi2 > 2.0 * shooting.dof
    found = noise_behind(shooting, fit)
    assert found is not None
    assert found.scale[0] == pytest.approx(1e-3, rel=0.3)
    assert found.innovation[0] == pytest.approx(1e-3 * np.sqrt(1 - pole**2), rel=0.12)
    again = dataclasses.replace(shooting, noise=found)
    anew = again.fit([((), ())], fit.starts)[0]
    assert anew.chi2 == pytest.approx(again.dof, rel=0.15)
    assert noise_behind(again, anew, raised(shooting.noise, found)) is None


@pytest.mark.parametrize("times", [0.7, 1.4])
def test_noise_that_differences_would_show_louder_or_quieter_is_no_filters(clean, times: float) -> None:
    floor = times * 1e-3 * np.sqrt((1 - 0.7**2) * high_differences((0.7, 0.0)))
    assert noise_behind(*with_noise(clean, floor, 1e-3, 0.7)) is None


@pytest.mark.parametrize("times", [1.4, 2.0, 0.7])
def test_beside_a_quick_motion_differences_may_see_more_than_the_noise(clean, monkeypatch, times: float) -> None:
    """They may see no less. What is slow in the noise may be louder alone."""
    monkeypatch.setattr("torch_activegp.diagnosis.preparation.noise_left.moves_quickly", lambda runs, channel: True)
    floor = times * 1e-3 * np.sqrt((1 - 0.7**2) * high_differences((0.7, 0.0)))
    found = noise_behind(*with_noise(clean, floor, 1e-3, 0.7))
    assert (found is not None) == (times > 1.0)
    if found is not None:
        assert found.innovation[0] == pytest.approx(1e-3 * np.sqrt(1 - 0.7**2), rel=0.15)


@pytest.mark.parametrize("moves", [True, False])
@pytest.mark.parametrize("hertz", [0.5, 2.0, 6.0, 8.0])
@pytest.mark.parametrize("size", [1e-3, 1.5e-3, 3e-3, 1e-2])
def test_slow_errors_of_physics_beside_white_noise_are_no_filters(clean, monkeypatch, hertz, size, moves) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.preparation.noise_left.moves_quickly", lambda runs, channel: moves)
    shooting, fit = with_noise(clean, 1e-3, 1e-3)
    rng = np.random.default_rng(7)
    time = np.arange(shooting.segments.intervals + 1) / 100
    phase = rng.uniform(0, 2 * np.pi, (len(fit.starts), 1))
    slow = size * np.sin(2 * np.pi * hertz * time[None] + phase)[..., None]
    segments = dataclasses.replace(shooting.segments, position=shooting.segments.position + slow)
    bent = dataclasses.replace(shooting, segments=segments)
    assert noise_behind(bent, bent.fit([((), ())], fit.starts)[0]) is None


@pytest.mark.parametrize("pole", [0.7, 0.88])
def test_a_filter_that_the_recordings_would_show_is_no_excuse(clean, monkeypatch, pole: float) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.preparation.noise_left.hides_filters", lambda runs, channel: False)
    floor = 1e-3 * np.sqrt((1 - pole**2) * high_differences((pole, 0.0)))
    assert noise_behind(*with_noise(clean, floor, 1e-3, pole)) is None


@pytest.mark.parametrize(("shown", "seen"), [(1.0, True), (1.13, True), (0.76, False)])
def test_behind_names_what_can_be_a_filter_alone_is_one(clean, monkeypatch, shown: float, seen: bool) -> None:
    """Also where a spectrum should have shown it: a tight loop moves up to the rates at which it would."""
    floor = 1e-3 * np.sqrt((1 - 0.7**2) * high_differences((0.7, 0.0)) / shown)
    shooting, fit = with_noise(clean, floor, 1e-3, 0.7)
    named = dataclasses.replace(fit, effects=(clean.effect("viscous_friction"),), values=(np.zeros(1),))
    assert noise_behind(shooting, named) is not None  # where none would show
    monkeypatch.setattr("torch_activegp.diagnosis.preparation.noise_left.hides_filters", lambda runs, channel: False)
    assert (noise_behind(shooting, named) is not None) is seen


def test_behind_names_too_what_differences_would_show_louder_is_no_filters(clean) -> None:
    floor = 1e-3 * np.sqrt((1 - 0.7**2) * high_differences((0.7, 0.0)) / 1.25)  # beside chance: 1.35 times as loud
    shooting, fit = with_noise(clean, floor, 1e-3, 0.7)
    named = dataclasses.replace(fit, effects=(clean.effect("viscous_friction"),), values=(np.zeros(1),))
    assert noise_behind(shooting, named) is None


def test_behind_names_a_filter_that_was_taken_for_a_quicker_one_is_seen(clean) -> None:
    """A spectrum above the motion showed a pole of 0.55 and too little noise; high differences see the same of both."""
    level = np.sqrt((1 - 0.8**2) * high_differences((0.8, 0.0)) / high_differences((0.55, 0.0)))
    quick = NoiseModel(np.array([1e-3 * level * colour_scale((0.55, 0.0)) ** -1]), np.array([[0.55, 0.0]]))
    shooting, fit = with_noise(clean, 1e-3, 1e-3, 0.8)
    taken = dataclasses.replace(shooting, noise=quick)
    named = dataclasses.replace(fit, effects=(clean.effect("viscous_friction"),), values=(np.zeros(1),))
    assert noise_behind(taken, fit) is None
    found = noise_behind(taken, named)
    assert found is not None
    assert found.colour[0, 0] > 0.6
    assert found.innovation[0] == pytest.approx(1e-3 * np.sqrt(1 - 0.8**2), rel=0.15)


def test_noise_whose_colour_is_known_is_not_made_louder(clean) -> None:
    floor = 1e-3 * np.sqrt((1 - 0.7**2) * high_differences((0.7, 0.0)))
    shooting, fit = with_noise(clean, floor, 1e-3, 0.7)
    other = dataclasses.replace(shooting, noise=NoiseModel(shooting.noise.scale, np.array([[0.2, 0.0]])))
    assert noise_behind(other, fit, shooting.noise) is None
    assert noise_behind(shooting, fit, other.noise) is None


def test_a_floor_is_raised_where_the_noise_is_louder() -> None:
    floor = NoiseModel.white(np.array([1.0, 1.0]))
    noise = NoiseModel(np.array([2.0, 0.5]), np.array([[0.5, 0.0], [0.5, 0.0]]))
    found = raised(floor, noise)
    np.testing.assert_allclose(found.scale, [2.0, 1.0])
    np.testing.assert_allclose(found.colour, [[0.5, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize(("level", "seen"), [(1e-3, True), (0.75e-3, False)])
def test_a_slight_colour_is_taken_for_noise_where_it_is_no_louder_than_the_floor(clean, level, seen) -> None:
    shooting, fit = with_noise(clean, level, 1e-3, 0.3)
    found = recoloured(shooting, fit)
    assert found.colour.any() == seen
    assert found.scale[0] == pytest.approx(1e-3 if seen else level, rel=0.1)
    if seen:
        assert omnibus(shooting, fit).excess > 2.0 * omnibus(dataclasses.replace(shooting, noise=found), fit).excess


@pytest.mark.parametrize(("rows", "level", "seen"), [(1, 0.85e-3, False), (2, 0.85e-3, True), (2, 0.75e-3, False)])
def test_a_slight_colour_may_be_louder_than_the_floor_where_rows_hide_it(clean, monkeypatch, rows, level, seen) -> None:
    """At 50 Hz nobody sees a filter; what it leaves is 1.4 times the floor, not 1.8."""
    shooting, fit = with_noise(clean, level, 1e-3, 0.3)
    slow = dataclasses.replace(
        shooting, segments=dataclasses.replace(shooting.segments, dt=rows * shooting.segments.dt)
    )
    assert slow.hides_colour is (rows > 1)
    left = noise_left._left(shooting, fit)
    monkeypatch.setattr(noise_left, "_left", lambda *_: left)
    asked: list[float] = []
    white = noise_left._Left.is_white_behind
    monkeypatch.setattr(
        noise_left._Left,
        "is_white_behind",
        lambda self, poles, least: asked.append(least) or white(self, poles, least),
    )
    assert recoloured(slow, fit).colour.any() == seen
    assert set(asked) <= {0.07}  # as white as what a spectrum should have shown


def test_white_noise_and_noise_of_a_known_colour_stay_as_they_are(clean) -> None:
    shooting, fit = with_noise(clean, 1e-3, 1e-3)
    assert not recoloured(shooting, fit).colour.any()
    known = NoiseModel(np.array([1e-3]), np.array([[0.2, 0.0]]))
    shooting, fit = with_noise(clean, 1e-3, 1e-3, 0.4)
    kept = recoloured(dataclasses.replace(shooting, noise=known), fit)
    np.testing.assert_array_equal(kept.colour, known.colour)
    np.testing.assert_array_equal(kept.scale, known.scale)


def test_a_strong_colour_is_no_slight_one(clean) -> None:
    assert not recoloured(*with_noise(clean, 1e-3, 1e-3, 0.8)).colour.any()


def test_a_periodic_error_is_not_taken_for_a_slight_colour(clean) -> None:
    shooting, fit = with_noise(clean, 1.2e-3, 1e-3)
    time = np.arange(shooting.segments.intervals + 1) / 100
    wave = 1e-3 * np.sin(2 * np.pi * 8.0 * time)[None, :, None]
    bent = dataclasses.replace(
        shooting, segments=dataclasses.replace(shooting.segments, position=shooting.segments.position + wave)
    )
    assert not recoloured(bent, bent.fit([((), ())], fit.starts)[0]).colour.any()


def test_slow_errors_of_physics_are_not_taken_for_a_slight_colour(clean) -> None:
    shooting, fit = with_noise(clean, 1e-3, 1e-3)
    time = np.arange(shooting.segments.intervals + 1) / 100
    slow = 1.5e-3 * np.sin(2 * np.pi * 3.0 * time)[None, :, None]
    segments = dataclasses.replace(shooting.segments, position=shooting.segments.position + slow)
    bent = dataclasses.replace(shooting, segments=segments)
    assert not recoloured(bent, bent.fit([((), ())], fit.starts)[0]).colour.any()


def left_behind(clean, errors: np.ndarray) -> bool:
    """Whether errors of recordings of a perfect model rise with the frequency."""
    segments = dataclasses.replace(clean.segments, position=bench_exact(clean) + errors)
    noise = NoiseModel.white(np.array([errors.std()]))
    shooting = dataclasses.replace(clean.shooting, segments=segments, noise=noise)
    return rises(shooting, shooting.fit([((), ())], clean.nominal.starts)[0])


@pytest.mark.parametrize("corner", [0.1, 0.3, 0.7])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_noise_rises_nowhere_whatever_filtered_it(clean, order: int, corner: float) -> None:
    shape = bench_exact(clean).shape
    white = 1e-3 * np.random.default_rng(0).normal(size=(shape[0], 400 + shape[1], shape[2]))
    assert not left_behind(clean, white[:, -shape[1] :])
    for passed in (lfilter, filtfilt):
        assert not left_behind(clean, passed(*butter(order, corner), white, axis=1)[:, 200 : 200 + shape[1]])


@pytest.mark.parametrize(("part", "seen"), [(2.0, True), (1.0, True), (0.1, False)])
def test_what_shakes_a_machine_rises_above_the_noise(clean, part: float, seen: bool) -> None:
    rng, shape = np.random.default_rng(1), bench_exact(clean).shape
    phase = rng.uniform(0.0, 2 * np.pi, (shape[0], 1, 1))
    shaken = np.sin(2 * np.pi * 0.15 * np.arange(shape[1])[None, :, None] + phase)
    assert left_behind(clean, 1e-3 * (rng.normal(size=shape) + part * np.sqrt(2.0) * shaken)) == seen


@pytest.fixture(scope="module")
def whole(clean):
    """The clean bench with runs that are not cut."""
    segments = cut(clean.machine.fit, 2.0, 0.0)
    shooting = dataclasses.replace(clean.shooting, segments=segments)
    nominal = shooting.fit([((), ())], clean.engine.starts(segments))[0]
    return dataclasses.replace(clean, segments=segments, shooting=shooting, nominal=nominal)


@pytest.mark.parametrize(("far", "seen"), [((60,), False), ((60, 150), True)])
def test_what_shakes_a_machine_slowly_is_told_by_longer_lags(whole, monkeypatch, far, seen: bool) -> None:
    """A pendulum shaken at 5 Hz, recorded at 250 Hz, was said to have noise that a filter would make."""
    monkeypatch.setattr(noise_left, "_FAR", far)
    rng, shape = np.random.default_rng(1), bench_exact(whole).shape
    phase = rng.uniform(0.0, 2 * np.pi, (shape[0], 1, 1))
    shaken = np.sin(2 * np.pi * 0.028 * np.arange(shape[1])[None, :, None] + phase)
    noise = lfilter([1.0], [1.0, -0.7], rng.normal(size=shape), axis=1)
    assert left_behind(whole, 1e-3 * (noise + 3.0 * shaken)) == seen


@pytest.mark.parametrize("corner", [0.03, 0.1, 0.7])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_noise_rises_nowhere_by_longer_lags_either(whole, order: int, corner: float) -> None:
    shape = bench_exact(whole).shape
    white = 1e-3 * np.random.default_rng(0).normal(size=(shape[0], 400 + shape[1], shape[2]))
    for passed in (lfilter, filtfilt):
        assert not left_behind(whole, passed(*butter(order, corner), white, axis=1)[:, 200 : 200 + shape[1]])


@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_noise_is_as_loud_in_every_segment(clean, pole: float) -> None:
    shooting, fit = with_noise(clean, 5e-4, 1e-3, pole)
    power, counts = by_segment(shooting, fit)
    assert power.shape == (1, shooting.segments.size)
    level = 4.0 * (1.0 - pole**2)
    np.testing.assert_allclose(power[0] / counts, level, rtol=4.0 * np.sqrt(2.0 / counts.min()))
    assert power.sum() / counts.sum() == pytest.approx(level, rel=0.2)
    louder = shooting.segments.position.copy()
    rng = np.random.default_rng(1)
    louder[2] += 5e-3 * rng.normal(size=louder[2].shape)
    segments = dataclasses.replace(shooting.segments, position=louder)
    again, counts = by_segment(dataclasses.replace(shooting, segments=segments), fit)
    assert np.argmax(again[0] / counts) == 2
    assert again[0, 2] > 10.0 * power[0, 2]


def test_too_few_values_are_in_no_segment(clean) -> None:
    shooting, fit = with_noise(clean, 1e-3, 1e-3)
    power, counts = by_segment(shooting.pick(np.arange(2)), fit.pick(np.arange(2)))
    assert power.shape == (0, 2)
    assert counts.tolist() == [0, 0]
