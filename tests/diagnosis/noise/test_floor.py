from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from scipy import signal

from torch_activegp.data import noise_std
from torch_activegp.diagnosis.noise.floor import hides_filters, noise_floor
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.noise.video import video_errors


def filtered(poles: tuple[float, float], rows: int) -> np.ndarray:
    """Autoregressive noise of unit variance, after it forgot its start."""
    fresh = np.random.default_rng(0).normal(size=rows + 500)
    out = np.zeros(rows + 500)
    for k in range(2, len(out)):
        out[k] = poles[0] * out[k - 1] + poles[1] * out[k - 2] + fresh[k]
    return out[500:] / out[500:].std()


def motion(rows: int) -> np.ndarray:
    return np.sin(2 * np.pi * 0.7 * np.arange(rows) / 100)


def test_white_noise_keeps_the_level_of_the_differences(make_plain_run) -> None:
    runs = [make_plain_run(motion(1000) + 1e-3 * filtered((0.0, 0.0), 1000), noise=n) for n in (3e-3, 4e-3)]
    found = noise_floor(runs)
    assert not found.colour.any()
    assert found.scale[0] == pytest.approx(np.sqrt(12.5) * 1e-3)


@pytest.mark.parametrize("poles", [(0.7, 0.0), (0.94, 0.0), (1.6, -0.64)])
def test_the_filter_is_found_under_a_motion(make_plain_run, poles) -> None:
    """Single poles are hard to tell from near ones: what counts is the spectrum, so the innovation."""
    position = motion(8000) + 1e-3 * filtered(poles, 8000)
    run = make_plain_run(position, noise=noise_std(torch.from_numpy(position)))
    found, true = noise_floor([run]), NoiseModel(np.array([1e-3]), np.array([poles]))
    assert found.colour.any()
    assert found.innovation[0] == pytest.approx(true.innovation[0], rel=0.35)


def test_a_motion_with_kinks_is_no_colour(make_plain_run) -> None:
    """A limit cycle in a backlash, 4 Hz: its harmonics reach through the whole band, and the noise is white."""
    rng, k = np.random.default_rng(0), np.arange(3000)
    cycle = np.abs((k * 0.0437 + 0.01 * np.cumsum(rng.normal(size=3000))) % 1.0 - 0.5)
    kinked = motion(3000) + 2e-2 * cycle + 5e-5 * rng.normal(size=3000)
    spectrum_alone = noise_floor([make_plain_run(kinked, noise=1e-3)])  # had differences seen much more
    assert spectrum_alone.colour.any()
    found = noise_floor([make_plain_run(kinked, noise=6e-5)])
    assert not found.colour.any()
    assert found.scale[0] == pytest.approx(6e-5)


@pytest.mark.parametrize(("part", "known"), [(0.03, True), (0.3, False), (100.0, True)])
def test_what_is_a_large_part_of_the_motion_is_motion(make_plain_run, part, known) -> None:
    """It falls as two poles do; a joint that rests has noise alone."""
    noise = part * motion(8000).std() * filtered((1.6, -0.64), 8000)
    found = noise_floor([make_plain_run(motion(8000) + noise, noise=noise_std(torch.from_numpy(noise)))])
    assert found.colour.any() == known


@pytest.mark.parametrize("poles", [(0.8, 0.0), (1.6, -0.64)])
def test_a_filter_hides_under_a_motion_in_the_band(make_plain_run, poles) -> None:
    """A machine that shakes at 14 to 27 Hz, recorded at 100 Hz; what a model leaves tells the filter."""
    rng, k = np.random.default_rng(0), np.arange(20000)
    frequency, phase = np.arange(0.14, 0.27, 0.003)[:, None], rng.uniform(0, 6, (44, 1))
    noise, shakes = filtered(poles, len(k)), np.sin(2 * np.pi * frequency * k + phase).sum(axis=0)
    for amplitude, hides in ((0.0, False), (2e-4, True)):
        position = amplitude * shakes + 1e-3 * noise
        run = make_plain_run(position, noise=noise_std(torch.from_numpy(position)))
        assert hides_filters([run], 0) == hides
        assert noise_floor([run]).colour.any() != hides


def test_a_quick_motion_is_no_colour(make_plain_run) -> None:
    """A servo follows a jittery target: its motion falls off through the band much as two poles would filter noise.

    Its noise is white or filtered; which, only what a model leaves can tell.
    """
    target = np.cumsum(1e-3 * np.random.default_rng(1).normal(size=4000))
    moved = signal.lfilter([0.0, 0.02, 0.02], [1.0, -1.6, 0.64], target)
    for poles in ((0.0, 0.0), (0.8, 0.0)):
        position = moved + 3e-6 * filtered(poles, 4000)
        run = make_plain_run(position, noise=noise_std(torch.from_numpy(position)))
        found = noise_floor([run])
        assert not found.colour.any()
        assert found.scale[0] == pytest.approx(3e-6, rel=0.4)
        assert hides_filters([run], 0)


def test_a_quick_motion_that_shows_no_more_to_differences_than_there_is_falls_off_too_steeply(make_plain_run) -> None:
    """Two poles of 0.94 and 134 times the noise are as loud at the upper end as what differences see."""
    target = np.cumsum(1e-3 * np.random.default_rng(1).normal(size=4000))
    moved = signal.lfilter([0.0, 0.02, 0.02], [1.0, -1.6, 0.64], target)
    position = moved + 6e-6 * filtered((0.0, 0.0), 4000)
    run = make_plain_run(position, noise=noise_std(torch.from_numpy(position)))
    assert noise_floor([run]).scale[0] == pytest.approx(6e-6, rel=0.2)
    assert hides_filters([run], 0)


def test_runs_that_show_no_spectrum_do_not_say_what_differences_see(make_plain_run) -> None:
    """A quiet run that is too short for a spectrum, and others that differ in loudness, leave the filter what it is."""
    noise = filtered((0.8, 0.0), 12000)
    loud = [make_plain_run(1e-3 * each, noise=noise_std(torch.from_numpy(1e-3 * each))) for each in np.split(noise, 3)]
    quiet = make_plain_run(1e-4 * noise[:200], noise=1e-5)
    assert noise_floor([loud[0], quiet, quiet, quiet]).colour.any()


def test_a_short_run_a_broken_one_and_a_slow_one_count_as_white(make_plain_run) -> None:
    noise = 1e-3 * filtered((0.8, 0.0), 2000)
    whole = make_plain_run(noise)
    assert noise_floor([whole]).colour.any()
    broken = make_plain_run(noise, np.arange(2000) % 2 == 0)
    slow = dataclasses.replace(whole, time=whole.time * 2)
    for run in (make_plain_run(noise[:200]), broken, slow):
        assert not noise_floor([run]).colour.any()


def test_filters_hide_where_no_spectrum_shows_them(make_plain_run) -> None:
    white, rng = 1e-3 * filtered((0.0, 0.0), 1000), np.random.default_rng(1)
    whole = make_plain_run(motion(1000) + white)
    assert not hides_filters([whole], 0)
    broken = make_plain_run(motion(1000) + white, recorded=rng.random(1000) > 0.2)
    short = make_plain_run((motion(1000) + white)[:200])
    slow = dataclasses.replace(whole, time=4 * whole.time)
    uneven = dataclasses.replace(whole, time=whole.time + 2e-3 * rng.random(1000))
    assert all(hides_filters([run], 0) for run in (broken, short, slow, uneven))
    assert not hides_filters([broken, whole], 0)
    assert not hides_filters([dataclasses.replace(slow, video=True)], 0)


def test_the_errors_of_a_video_are_its_noise(make_plain_run) -> None:
    """Other slow recorders are believed."""
    run = make_plain_run(motion(60), noise=1e-3)
    slow = dataclasses.replace(run, time=run.time * 100 / 15)
    found = noise_floor([dataclasses.replace(slow, video=True)])
    colour, scale = video_errors([dataclasses.replace(slow, video=True)], 1e-3)
    assert found.scale[0] == pytest.approx(scale)
    np.testing.assert_allclose(found.colour[0], colour)
    assert not noise_floor([slow]).colour.any()


def test_no_floor_is_below_what_rigid_bodies_hold(make_plain_run) -> None:
    run = make_plain_run(motion(1000), noise=1e-12)
    assert noise_floor([run]).scale[0] == pytest.approx(3e-5 * motion(1000).std(), rel=1e-6)


def test_the_noise_of_a_prescribed_joint_comes_on_top(make_plain_run) -> None:
    """Grown by a half, as it is in simulations; the rigid bodies' floor is no noise of what is prescribed."""
    rig = make_plain_run(motion(1000), noise=4e-3)
    run = dataclasses.replace(make_plain_run(motion(1000), noise=3e-3), prescribed=rig, coupling=np.array([[0.5]]))
    assert noise_floor([run]).scale[0] == pytest.approx(1e-3 * np.hypot(3.0, 1.5 * 2.0))
    exact = dataclasses.replace(
        run, prescribed=dataclasses.replace(rig, position=1e6 * rig.position, noise=np.zeros(1))
    )
    assert noise_floor([exact]).scale[0] == pytest.approx(3e-3)
