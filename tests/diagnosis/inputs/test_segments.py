from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.segments import cut, halve


@pytest.mark.parametrize(
    ("rows", "seconds", "pad"), [((201, 173), 0.5, 0.1), ((60,), 10.0, 0.0), ((50, 14), 0.13, 0.2)]
)
def test_each_row_behind_the_pad_counts_once(make_plain_run, rows, seconds, pad) -> None:
    rng = np.random.default_rng(0)
    runs = [make_plain_run(rng.normal(size=n)) for n in rows]
    segments = cut(runs, seconds, pad)
    seen = [np.zeros(n, dtype=int) for n in rows]
    for s in range(segments.size):
        for k in np.flatnonzero(segments.counts[s]):
            row = segments.first[s] + k
            seen[segments.run[s]][row] += 1
            assert segments.position[s, k, 0] == runs[segments.run[s]].position[row, 0]
    for run, times in zip(runs, seen, strict=True):
        before = min(int(np.ceil(pad * 100 - 1e-9)), (len(run) - 1) // 6)
        assert times[:before].sum() == 0
        assert (times[before:] == 1).all()


def test_segments_are_about_as_long_as_asked(make_plain_run) -> None:
    segments = cut([make_plain_run(np.zeros(301))], 0.5, 0.1)
    assert segments.size == 6
    assert segments.counts.sum(axis=1).min() >= 48
    assert segments.intervals * 0.01 == pytest.approx(0.6, abs=0.02)


def test_rows_that_were_not_recorded_do_not_count(make_plain_run) -> None:
    recorded = np.ones(101, dtype=bool)
    recorded[40:45] = False
    assert cut([make_plain_run(np.zeros(101), recorded)], 0.25, 0.0).counts.sum() == 96


def test_segments_shorter_than_a_step_have_an_interval_each(make_plain_run) -> None:
    segments = cut([make_plain_run(np.zeros(21))], 1e-4, 0.0)
    assert segments.size == 20
    assert segments.counts.sum() == 21


def test_take_gives_the_columns_of_the_runs_and_holds_the_last_row(bench) -> None:
    segments = bench.segments
    control, smooth = segments.take("control"), segments.take("smooth")
    assert control.shape == (segments.size, segments.intervals, 1)
    assert smooth.shape == segments.position.shape
    run, first = segments.runs[segments.run[3]], segments.first[3]
    np.testing.assert_array_equal(control[3, :5], run.control[first : first + 5])
    np.testing.assert_array_equal(smooth[3, :5], run.smooth[first : first + 5])
    short = segments.pick(np.array([segments.size - 1]))
    assert short.take("control")[0, -1] == segments.runs[-1].control[-1]


def test_pick_and_centers(bench) -> None:
    some = bench.segments.pick(np.array([1, 4]))
    assert some.size == 2
    np.testing.assert_array_equal(some.position, bench.segments.position[[1, 4]])
    np.testing.assert_allclose(some.centers(), bench.segments.centers()[[1, 4]])
    np.testing.assert_allclose(some.centers(), 0.01 * some.scored.mean(axis=1))


def test_halves_hold_the_rows_of_the_whole(make_plain_run) -> None:
    runs = [make_plain_run(np.arange(201.0)), make_plain_run(np.arange(90.0))]
    segments = cut(runs, 0.5, 0.1)
    which = np.zeros(segments.size, dtype=bool)
    which[[1, segments.size - 1]] = True
    halved = halve(segments, which)
    assert halved.size == segments.size + 2
    assert halved.counts.sum() == segments.counts.sum()
    np.testing.assert_array_equal(halved.position[halved.counts], segments.position[segments.counts])
    assert (np.diff(halved.scored, axis=1) > 0).all()
    np.testing.assert_array_equal(halve(segments, ~which & which).scored, segments.scored)


def test_short_segments_are_not_halved(make_plain_run) -> None:
    segments = cut([make_plain_run(np.zeros(61))], 0.1, 0.0)
    assert halve(segments, np.ones(segments.size, dtype=bool)).size == segments.size


def test_a_segment_is_far_off_by_its_own_samples(bench) -> None:
    samples = bench.segments.counts.sum(axis=1)
    assert not bench.segments.far_off(29.0 * samples).any()
    assert bench.segments.far_off(31.0 * samples).all()


@pytest.mark.parametrize(("times", "parts"), [(1, 1), (200, 2)])
def test_segments_of_like_length_go_together_where_that_is_worth_a_call(make_plain_run, times: int, parts: int) -> None:
    runs = [make_plain_run(np.zeros(n)) for n in (101, 21, 20, 101)]
    segments = cut(runs, 10.0, 0.0)
    assert segments.lengths.tolist() == [100, 20, 19, 100]
    groups = segments.of_like_length(times)
    assert sorted(np.concatenate(groups)) == [0, 1, 2, 3]
    assert [g.tolist() for g in groups] == ([[0, 1, 2, 3]] if parts == 1 else [[0, 3], [1, 2]])
    assert len(cut([runs[0]], 0.25, 0.0).of_like_length(1000)) == 1


def test_the_beginning_of_segments(make_plain_run) -> None:
    segments = cut([make_plain_run(np.arange(101.0))], 0.5, 0.0)
    begun = segments.until(7)
    assert begun.intervals == 7
    assert begun.counts.shape == begun.position.shape[:2] == (2, 8)
    np.testing.assert_array_equal(begun.position[1], segments.position[1, :8])


def test_segments_are_spread_evenly_from_the_first_to_the_last(bench) -> None:
    segments = bench.segments
    assert segments.size > 5
    some = segments.spread(3)
    assert some.tolist() == [0, (segments.size - 1) // 2, segments.size - 1]
    assert segments.spread(10 * segments.size).tolist() == list(range(segments.size))


def test_a_segment_is_cut_where_it_is_said(make_plain_run) -> None:
    segments = cut([make_plain_run(np.zeros(301))], 1.0, 0.0)
    found = halve(segments, np.array([True, False, True]), np.array([0.5, 0.5, 1 / 3]))
    assert found.scored.tolist() == [[0, 50], [50, 100], [100, 200], [200, 233], [233, 300]]
    assert found.counts.sum() == 301
    assert halve(segments, np.ones(3, dtype=bool), 0.02).size == 3  # too short a piece
