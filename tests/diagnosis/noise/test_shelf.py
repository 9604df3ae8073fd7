from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from scipy import signal

from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.noise.floor import filter_beside, hides_filters, noise_floor, steep_filters
from torch_activegp.diagnosis.noise.shelf import shelf, shelf_behind, shelf_beside

RATE, LOUD = 250.0, 7e-4


def spectrum(values: np.ndarray, window: int = 128) -> tuple[np.ndarray, np.ndarray]:
    frequency, power = signal.welch(
        values, window="blackmanharris", nperseg=window, detrend=signal.detrend, average="median"
    )
    return frequency[4:-2], power[4:-2]


def filtered(order: int, corner: float, both: bool, rows: int = 8000) -> np.ndarray:
    """A swing at 0.7 Hz and white noise, behind a Butterworth filter whose corner is in Hz; and its noise alone."""
    noise = LOUD * np.random.default_rng(0).normal(size=rows)
    swing = np.sin(2 * np.pi * 0.7 * np.arange(rows) / RATE)
    b, a = signal.butter(order, corner, fs=RATE)
    passed = (signal.filtfilt if both else signal.lfilter)(b, a, np.stack([swing + noise, noise]))
    return np.asarray(passed[:, 200:])


@pytest.mark.parametrize(("order", "corner", "both"), [(2, 30.0, True), (4, 25.0, True), (4, 40.0, False)])
def test_the_corner_and_the_level_of_a_steep_filter_are_found(order: int, corner: float, both: bool) -> None:
    values, noise = filtered(order, corner, both)
    found = shelf(*spectrum(values))
    assert found is not None
    assert found.scale == pytest.approx(noise.std(), rel=0.15)
    assert found.corner * RATE == pytest.approx(corner, rel=0.15)
    kept = noise[:: found.rows]
    assert abs(np.corrcoef(kept[1:], kept[:-1])[0, 1]) < 0.35  # in between it is 0.9 and more
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] > 0.8


def test_motion_is_no_shelf() -> None:
    """A mass under forces that are level up to 60 Hz, without noise that is seen; and white noise."""
    rng = np.random.default_rng(0)
    b, a = signal.butter(4, 60.0, fs=RATE)
    force = signal.lfilter(b, a, rng.normal(size=20000))
    mass = signal.lfilter([1.0], [1.0, -1.98, 0.981], force)
    assert shelf(*spectrum(mass)) is None
    assert shelf(*spectrum(rng.normal(size=8000))) is None
    assert shelf(*spectrum(mass + 0.1 * rng.normal(size=20000))) is None


@pytest.mark.parametrize(("rate", "corner"), [(250.0, 30.0), (250.0, 15.0), (500.0, 30.0), (1000.0, 60.0)])
def test_the_floor_is_the_level_behind_the_filter(make_plain_run, rate: float, corner: float) -> None:
    values, noise = filtered(2, corner * RATE / rate, True, 16000)
    run = make_plain_run(values, noise=1e-6)  # as differences see it
    run = dataclasses.replace(run, time=np.arange(len(run)) / rate)
    assert steep_filters([run])[0] is not None
    floor = noise_floor([run])
    assert floor.scale[0] == pytest.approx(noise.std(), rel=0.15)
    assert not floor.colour.any()
    assert not hides_filters([run], 0)


def swift(rows: int = 16000) -> tuple[np.ndarray, np.ndarray]:
    """A mass under forces up to 12 Hz and white noise, behind a Butterworth filter of 18 Hz; and its noise alone."""
    rng = np.random.default_rng(1)
    force = signal.filtfilt(*signal.butter(4, 12.0, fs=RATE), rng.normal(size=rows))
    motion = signal.lfilter([1e-4], [1.0, -1.98, 0.981], force)
    noise = LOUD * rng.normal(size=rows)
    passed = signal.filtfilt(*signal.butter(2, 18.0, fs=RATE), np.stack([motion + noise, noise]))
    return np.asarray(passed[:, 200:])


def test_a_filter_counts_for_the_joint_whose_motion_hides_it(make_plain_run) -> None:
    """Alone its noise would be a tenth of what it is."""
    hidden, noise = swift()
    plain, own = filtered(2, 18.0, True, 16000)
    time = np.arange(len(hidden)) / RATE
    alone = dataclasses.replace(make_plain_run(hidden, noise=1e-6), time=time)
    runs = [dataclasses.replace(make_plain_run(np.stack([hidden, plain], axis=1), noise=1e-6), time=time)]
    assert steep_filters([alone])[0] is None
    floor = noise_floor(runs)
    assert floor.scale == pytest.approx([noise.std(), own.std()], rel=0.25)
    assert not hides_filters(runs, 0)
    assert len({one.corner for one in steep_filters(runs)}) == 1


@pytest.mark.parametrize("window", [128, 256])
def test_motion_is_behind_no_filter_of_another_joint(window: int) -> None:
    """Whatever noise there is, and where the force ends too."""
    rng = np.random.default_rng(0)
    mass = signal.lfilter([1.0], [1.0, -1.98, 0.981], rng.normal(size=20000))
    smooth = signal.lfilter(*signal.butter(2, 30.0, fs=RATE), mass)
    for motion, noise in ((mass, 0.0), (mass, 1e-4), (mass, 1.0), (smooth, 0.0)):
        seen = spectrum(motion + noise * rng.normal(size=20000), window)
        for order, corner in itertools.product(
            [(2, 1), (3, 1), (4, 1), (1, 2), (2, 2), (4, 2)], [0.04, 0.06, 0.1, 0.2]
        ):
            assert shelf_behind(*seen, SteepFilter(corner, LOUD, order)) is None


def test_a_filter_is_known_again_where_it_was_seen_a_little_off() -> None:
    seen = spectrum(swift()[0])
    assert shelf_behind(*seen, SteepFilter(18.0 / RATE, LOUD, (2, 2))) is not None
    assert shelf_behind(*seen, SteepFilter(0.9 * 18.0 / RATE, LOUD, (2, 2))) is not None
    assert shelf_behind(*seen, SteepFilter(0.5 * 18.0 / RATE, LOUD, (2, 2))) is None
    assert shelf_behind(*seen, SteepFilter(18.0 / RATE, 1e-3 * LOUD, (2, 2))) is None  # a thousand times as loud


def beside(make_plain_run, channels: list[np.ndarray], shown: list[SteepFilter | None]) -> SteepFilter | None:
    """The filter of the first of some channels."""
    run = make_plain_run(np.stack(channels, axis=1), noise=1e-6)
    return filter_beside([dataclasses.replace(run, time=np.arange(len(run)) / RATE)], 0, shown)


@pytest.mark.parametrize("louder", [0.1, 1.0, 20.0, 40.0])
@pytest.mark.parametrize("judged", [(2, 1), (2, 2)])
def test_beside_a_sibling_in_proportion_a_filter_tells_the_level_though_its_order_is_misjudged(
    make_plain_run, louder: float, judged: tuple[int, int]
) -> None:
    """Not of what would be 40 times as loud, nor where no sibling shows a filter, nor of noise that is white."""
    hidden, noise = swift()
    plain, own = filtered(2, 18.0, True, 16000)
    known = SteepFilter(18.0 / RATE, own.std(), judged)
    found = beside(make_plain_run, [louder * hidden, plain], [None, known])
    if louder > 30.0:
        assert found is None
    else:
        assert found is not None
        assert found.scale == pytest.approx(louder * noise.std(), rel=0.2)
    assert beside(make_plain_run, [hidden, plain], [None, None]) is None
    white = np.random.default_rng(0).normal(size=len(plain))
    assert beside(make_plain_run, [white, plain], [None, known]) is None


@pytest.mark.parametrize("corner", [18.0, 25.0])
@pytest.mark.parametrize("ratio", [0.1, 0.3, 1.0])
def test_motions_in_proportion_are_no_noise(make_plain_run, corner: float, ratio: float) -> None:
    """Of two joints that one force moves, up to 60 Hz, behind one filter."""
    rng = np.random.default_rng(2)
    force = signal.filtfilt(*signal.butter(4, 60.0, fs=RATE), rng.normal(size=16000))
    motion = signal.lfilter([1e-2], [1.0, -1.98, 0.981], force)
    passes = signal.butter(2, corner, fs=RATE)
    noise = signal.filtfilt(*passes, LOUD * rng.normal(size=(2, 16000)))
    moved = signal.filtfilt(*passes, np.stack([motion, motion / ratio]))
    known = SteepFilter(corner / RATE, float(noise[1].std()), (2, 2))
    assert beside(make_plain_run, [*(moved + noise)[:, 200:]], [None, known]) is None


@pytest.mark.parametrize("loud", [1e-3, 1e-2, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("both", [True, False])
def test_a_mass_falls_beside_no_filter_of_another_joint(loud: float, both: bool) -> None:
    """However loud; behind two poles forth alone noise falls as it does."""
    mass = signal.lfilter([1.0], [1.0, -1.98, 0.981], np.random.default_rng(0).normal(size=20000))
    values, noise = filtered(2, 18.0, both, 20200)
    frequency, sibling = spectrum(values)
    power, high = spectrum(mass)[1], frequency > 0.2
    power = loud * power * np.exp(np.mean(np.log(sibling[high] / power[high])))
    known = SteepFilter(18.0 / RATE, float(noise.std()), (2, 2 if both else 1))
    assert shelf_beside(frequency, power, sibling, known) is None


def test_few_bins_and_other_shapes_tell_nothing_beside_a_sibling() -> None:
    values, noise = filtered(2, 18.0, True, 20200)
    frequency, sibling = spectrum(values)
    known = SteepFilter(18.0 / RATE, float(noise.std()), (2, 2))
    assert shelf_beside(frequency, sibling, sibling, known) is not None
    ripple = sibling * 10.0 ** (0.5 * np.sin(120.0 * frequency))
    assert shelf_beside(frequency, ripple, sibling, known) is None
    assert shelf_beside(frequency[::4], sibling[::4], sibling[::4], known) is None
    end = int((frequency < 0.15).sum())  # the rest is rounding
    short = np.where(np.arange(len(sibling)) < end, sibling, sibling[end])
    assert shelf_beside(frequency, short, sibling, known) is None


@pytest.mark.parametrize("corner", [18.0, 25.0, 37.0])
def test_a_joint_without_a_filter_beside_one_with_it_has_its_own_noise(make_plain_run, corner: float) -> None:
    rng, rows, quiet = np.random.default_rng(0), 16000, 1e-5
    mass = signal.lfilter([1.0], [1.0, -1.998, 0.9981], rng.normal(size=10 * rows))[::10]
    bare = 0.3 / mass.std() * mass + quiet * rng.normal(size=rows)
    behind = signal.filtfilt(*signal.butter(2, corner, fs=RATE), LOUD * rng.normal(size=rows))
    run = make_plain_run(np.stack([bare, behind], axis=1), noise=quiet)
    run = dataclasses.replace(run, time=np.arange(rows) / RATE)
    found = steep_filters([run])
    assert found[0] is None
    assert found[1] is not None


def short(make_plain_run, joints: int, behind: bool, noise: float = LOUD) -> list:
    """Three runs of five seconds at 100 Hz: masses under forces of up to 10 Hz, louder from run to run, and noise."""
    rng, rows, runs = np.random.default_rng(3), 500, []
    for loud in (1.0, 4.0, 12.0):
        force = signal.filtfilt(*signal.butter(4, 0.2), rng.normal(size=(rows + 400, joints)), axis=0)
        values = loud * signal.lfilter([1e-3], [1.0, -1.97, 0.972], force, axis=0)
        values = values + noise * rng.normal(size=values.shape)
        if behind:
            values = signal.filtfilt(*signal.butter(2, 0.48), values, axis=0)
        run = make_plain_run(values[200:-200], noise=1e-6)
        runs.append(dataclasses.replace(run, time=np.arange(rows) / 100.0))
    return runs


def test_a_filter_that_no_joint_shows_alone_is_seen_in_all_together(make_plain_run) -> None:
    runs = short(make_plain_run, 7, behind=True)
    some = [[dataclasses.replace(run, position=run.position[:, c : c + 2]) for run in runs] for c in range(6)]
    assert [steep_filters(pair) for pair in some] == [[None, None]] * 6
    found = steep_filters(runs)
    noise = signal.filtfilt(*signal.butter(2, 0.48), LOUD * np.random.default_rng(0).normal(size=20000))
    assert [one and one.scale for one in found] == pytest.approx([noise.std()] * 7, rel=0.2)


@pytest.mark.parametrize("rests", [0.0, 0.3])
def test_a_joint_that_rests_hides_no_filter_of_the_others(make_plain_run, rests: float) -> None:
    still = []
    for run in short(make_plain_run, 7, behind=True):
        position = run.position.copy()
        position[:, 2] = rests
        still.append(dataclasses.replace(run, position=position))
    found = steep_filters(still)
    assert [one is not None for one in found] == [True, True, False, True, True, True, True]


@pytest.mark.parametrize("noise", [LOUD, 1e-8])
def test_joints_without_a_filter_show_none_together(make_plain_run, noise: float) -> None:
    assert steep_filters(short(make_plain_run, 7, behind=False, noise=noise)) == [None] * 7


def test_where_the_lowest_bins_are_quiet_little_is_left_to_see_a_filter_by() -> None:
    frequency = np.linspace(0.02, 0.5, 60)
    behind = (1.0 + (np.tan(0.999 * np.pi * frequency) / np.tan(np.pi * 0.2)) ** 6) ** -1
    assert shelf(frequency, behind, 0.0, 2.5) is not None
    quiet = behind.copy()
    quiet[0] = 1e-6
    assert shelf(frequency, quiet, 0.0, 2.5) is not None  # from the second bin on
    quiet[::4] = 1e-6
    assert shelf(frequency, quiet, 0.0, 2.5) is None


@pytest.mark.parametrize(("step", "seen"), [(0.0, False), (5e-4, True), (2e-3, False)])
def test_a_filter_beneath_the_rounding_of_an_encoder_is_seen_where_it_is_loud_enough(step: float, seen: bool) -> None:
    """Behind steps of three times the noise there is next to nothing of it; white noise alone is no shelf."""
    rng = np.random.default_rng(0)
    noise = signal.filtfilt(*signal.butter(2, 30.0, fs=RATE), LOUD * rng.normal(size=8000))
    rounded = step * np.round(noise / step) if step else LOUD * rng.normal(size=8000)
    found = shelf(*spectrum(rounded), white=2.0 * (step or LOUD) ** 2 / (12.0 if step else 1.0))
    assert (found is not None) is seen
    if found is not None:
        assert found.corner * RATE == pytest.approx(30.0, rel=0.15)
        assert found.scale == pytest.approx(rounded.std(), rel=0.15)
