from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import signal

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.runs import Channels, make_run
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.floor import INNER, noise_floor, steep_filters
from torch_activegp.diagnosis.noise.shelf import LOWEST
from torch_activegp.diagnosis.preparation import filters_left as module
from torch_activegp.diagnosis.preparation.filtered_rows import thinned
from torch_activegp.diagnosis.preparation.filters_left import filters_left, is_smooth, resolution, white_behind
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine

NOISE, RATE, CORNER = 2e-3, 50, 14.0


def machine(model, corner: float | None, push: float = 0.0, rows: int = 401, step: float = 0.0, **behind: float):
    """Runs of the model at 50 Hz or so, with a push that it does not know, and positions filtered forth and back.

    And with white noise behind that, and rounded to steps.
    """
    found, rate, white = [], behind.get("rate", RATE), behind.get("white", 0.0)
    for seed in range(5):
        rng, time = np.random.default_rng(seed), np.arange(rows) / rate
        control = 2.0 * np.sin(2 * np.pi * rng.uniform(0.3, 1.0, 3) * time[:, None]).sum(axis=1)
        columns = {"time": time, "qpos.hip": 0.1 * time, "ctrl.drive": control + push}
        whole = Recording.from_columns("run", columns)
        run = make_run(whole, model, channels := Channels.of(model, [whole]))
        path = Engine(model, channels, 4).predict(cut([run], 1e9, 0.0), np.zeros((1, 1, 2)), [NOMINAL])[0, 0, :, 0]
        seen = path + NOISE * rng.normal(size=rows)
        if corner is not None:
            seen = signal.filtfilt(*signal.butter(3, corner, fs=rate), seen)
        seen = seen + white * rng.normal(size=rows)
        seen = step * np.round(seen / step) if step else seen
        found.append(Recording.from_columns(f"run{seed}", columns | {"qpos.hip": seen, "ctrl.drive": control}))
    return make_machine(model, found, [])


@pytest.mark.parametrize("push", [0.0, 1.0])
def test_a_filter_is_seen_in_what_a_nominal_leaves_that_misses_something(model, push: float) -> None:
    """Recordings at 50 Hz have no band above the motion."""
    made = machine(model, CORNER, push)
    assert steep_filters(made.fit) == [None]
    (found,) = filters_left(made, 1)
    assert found is not None
    assert found.corner == pytest.approx(CORNER / RATE, rel=0.15)
    assert found.scale == pytest.approx(NOISE * np.sqrt(2.0 * CORNER / RATE), rel=0.2)


def test_white_noise_and_few_or_short_segments_show_none(model, monkeypatch) -> None:
    white = machine(model, None, push=1.0)
    assert not is_smooth(white.fit, 0)
    assert filters_left(white, 1) == [None]
    made = machine(model, CORNER)
    assert filters_left(dataclasses.replace(made, fit=made.fit[:1]), 1) == [None]
    monkeypatch.setattr(module, "_ROWS", 60)
    assert filters_left(made, 1) == [None]


@pytest.mark.parametrize(("every", "seen"), [((), True), ((0, 1), True), ((0, 1, 2), False)])
def test_segments_with_missing_rows_say_nothing(model, every: tuple[int, ...], seen: bool) -> None:
    """The middle row is missing in none, two or three of four seconds; a filter is seen in whole ones, if enough."""
    made = machine(model, CORNER)
    rows = np.arange(401)
    lost = (rows % RATE == RATE // 2) & np.isin(rows // RATE % 4, every)
    runs = tuple(dataclasses.replace(run, left_out=lost) for run in made.fit)
    (found,) = filters_left(dataclasses.replace(made, fit=runs), 1)
    assert (found is not None) is seen


def test_rows_count_as_the_filter_that_is_left_says(model) -> None:
    made = machine(model, CORNER)
    found = thinned(made, 1)
    assert found.notes[-1].startswith(("qpos.hip: filtered at about 14 Hz", "qpos.hip: filtered at about 15 Hz"))
    assert noise_floor(found.fit).scale == pytest.approx(NOISE * np.sqrt(2.0 * CORNER / RATE), rel=0.2)
    assert noise_floor(made.fit).scale < 0.5 * noise_floor(found.fit).scale


def test_videos_and_uneven_clocks_are_not_asked(model) -> None:
    made = machine(model, CORNER)
    assert is_smooth(made.fit, 0)
    assert not is_smooth([dataclasses.replace(run, video=True) for run in made.fit], 0)
    jitter = 0.002 * np.random.default_rng(0).uniform(size=len(made.fit[0]))
    assert not is_smooth([dataclasses.replace(run, time=run.time + jitter) for run in made.fit], 0)
    assert not is_smooth([dataclasses.replace(run, position=0.0 * run.position) for run in made.fit], 0)


@pytest.mark.parametrize(("share", "louder", "seen"), [(0.0, 0.1, True), (1.0, 0.1, False), (1.0, 10.0, True)])
def test_a_part_of_a_motion_that_ends_somewhere_is_no_filter(share: float, louder: float, seen: bool) -> None:
    """What a loop makes of noise is coherent with it, but less."""
    rng, rows = np.random.default_rng(0), 128
    sections = signal.butter(4, 0.2, fs=1.0, output="sos")
    own, other = (signal.sosfiltfilt(sections, rng.normal(size=(40, 3 * rows)))[:, rows:-rows] for _ in range(2))
    rest = louder * (share * own + (1.0 - share) * other)
    spectra = (module._spectra(some) for some in (rest, own))
    found = module._filter(*spectra, np.fft.rfftfreq(rows)[INNER], LOWEST / 250)
    assert (found is not None) is seen


@pytest.mark.parametrize(("corner", "seen"), [(CORNER, True), (None, False)])
def test_a_filter_beneath_the_rounding_of_an_encoder_is_seen(model, corner: float | None, seen: bool) -> None:
    """Differences see the rounding alone, and nothing of a filter in front of it."""
    made = machine(model, corner, step=1.5e-3 if corner else 2e-2)
    assert not is_smooth(made.fit, 0)
    (found,) = filters_left(made, 1)
    assert (found is not None) is seen
    if found is not None:
        assert found.corner == pytest.approx(CORNER / RATE, rel=0.15)
        assert found.scale == pytest.approx(NOISE * np.sqrt(2.0 * CORNER / RATE), rel=0.2)


def test_where_rounding_is_all_that_is_fast_no_filter_is_asked_for(model) -> None:
    made = machine(model, CORNER, step=1.5e-3)
    assert white_behind(made.fit, 0) == pytest.approx(2.0 * 1.5e-3**2 / 12.0)
    assert white_behind(machine(model, CORNER).fit, 0) == 0.0
    assert white_behind(machine(model, None, step=1e-4).fit, 0) == 0.0  # beneath white noise
    assert white_behind(machine(model, CORNER, step=4e-2).fit, 0) == 0.0
    assert white_behind([dataclasses.replace(run, video=True) for run in made.fit], 0) == 0.0


@pytest.mark.parametrize(("white", "seen"), [(1e-4, True), (4e-4, False)])
def test_a_filter_beneath_white_noise_that_is_far_quieter_is_seen(model, white: float, seen: bool) -> None:
    made = machine(model, CORNER, rows=801, rate=125, white=white)
    assert not is_smooth(made.fit, 0)
    assert (white_behind(made.fit, 0) == pytest.approx(2.0 * white**2, rel=0.3)) is seen
    (found,) = filters_left(made, 1)
    assert (found is not None) is seen
    if found is not None:
        assert found.corner == pytest.approx(CORNER / 125, rel=0.15)
        assert found.scale == pytest.approx(NOISE * np.sqrt(2.0 * CORNER / 125), rel=0.2)


def encoder() -> np.ndarray:
    """Counts of 8192 a turn, in rad."""
    return 2 * np.pi / 8192 * np.random.default_rng(0).integers(-2000, 2000, 900)


@pytest.mark.parametrize(
    "written", [lambda q: q, lambda q: q + 0.12, lambda q: q.astype(np.float32), lambda q: q.round(5)]
)
def test_the_step_of_an_encoder_is_that_of_its_counts_however_it_was_written(written) -> None:
    assert resolution(written(encoder())) == pytest.approx(2 * np.pi / 8192, rel=1e-3)


@pytest.mark.parametrize("values", [np.zeros(5), np.random.default_rng(0).normal(size=900), np.array([0.0, 1.0, 1.7])])
def test_what_does_not_move_and_what_is_not_rounded_has_no_step(values) -> None:
    assert resolution(values) == 0.0


def test_glitches_and_runs_at_rest_hide_no_rounding(model) -> None:
    made = machine(model, CORNER, step=1.5e-3)
    first, *others = made.fit
    lost = np.zeros(len(first), dtype=bool)
    lost[50] = True
    position = first.position.copy()
    position[50] += 0.4e-3
    runs = [dataclasses.replace(first, position=position, left_out=lost), *others]
    runs.append(dataclasses.replace(first, position=np.full_like(first.position, 0.3)))
    assert white_behind(runs, 0) > 0.0
    assert white_behind([dataclasses.replace(first, position=position), *others], 0) == 0.0  # off the grid
