from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.ram import ram
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation import lengths
from torch_activegp.diagnosis.preparation.lengths import followed_by, longest, uncut
from torch_activegp.diagnosis.preparation.numerics import Numerics


@pytest.fixture
def forms(bench):
    return Numerics.of(bench.machine, 1)


def test_segments_that_cannot_be_shorter_end_the_search(bench, forms, monkeypatch) -> None:
    monkeypatch.setattr(lengths, "_SHORTEST", 0.0)
    found = longest(bench.machine, forms, bench.shooting.noise, -1.0)
    assert (found.segments.scored[:, 1] - found.segments.scored[:, 0]).max() < 24
    assert len(found.nominal.per_segment) == found.segments.size
    assert found.halved


def test_segments_are_not_halved_where_the_nominal_follows(bench, forms) -> None:
    found = longest(bench.machine, forms, bench.shooting.noise, 1e9)
    assert found.segments.size == uncut(bench.machine).size
    assert found.nominal is found.uncut
    assert not found.halved


def test_another_bar_halves_others_and_does_not_fit_the_longest_again(bench, forms, monkeypatch) -> None:
    noise = bench.shooting.noise
    near = longest(bench.machine, forms, noise, 1.0)
    assert near.halved
    sizes: list[int] = []
    fit = lengths._roughly
    monkeypatch.setattr(
        lengths, "_roughly", lambda shooting, *how: sizes.append(shooting.segments.size) or fit(shooting, *how)
    )
    again = longest(bench.machine, forms, noise, 1.0, near)
    assert uncut(bench.machine).size not in sizes
    assert again.segments.size == near.segments.size
    np.testing.assert_array_equal(again.nominal.per_segment, near.nominal.per_segment)
    sizes.clear()
    assert not longest(bench.machine, forms, noise, 1e9, near).halved
    assert not sizes


def test_segments_are_not_cut_shorter_than_they_may_be(bench, forms) -> None:
    found = longest(bench.machine, forms, bench.shooting.noise, -1.0).segments
    seconds = found.dt[:, 0] * np.diff(found.scored, axis=1)[:, 0]
    assert 0.45 * 0.25 < seconds.min() <= seconds.max() <= 1.5 * 0.25 + 0.02  # a third of 1.5 times the shortest


def test_segments_over_which_errors_grow_are_halved(bench, forms, monkeypatch) -> None:
    monkeypatch.setattr(lengths, "_GROWTH", 0.0)
    assert longest(bench.machine, forms, bench.shooting.noise, np.inf).halved


@pytest.mark.parametrize("better", ["coarse", "late"])
def test_the_cheap_form_by_which_the_nominal_follows_better_is_kept(bench, forms, monkeypatch, better: str) -> None:
    form, fit = getattr(forms, better), lengths._roughly
    assert form is not None

    def worse(shooting, *how):
        found = fit(shooting, *how)
        return found if shooting.engine is form else dataclasses.replace(found, chi2=2.0 * found.chi2)

    monkeypatch.setattr(lengths, "_roughly", worse)
    found = longest(bench.machine, forms, bench.shooting.noise, 1.0)
    assert found.form is form
    used = []
    monkeypatch.setattr(lengths, "_roughly", lambda shooting, *how: used.append(shooting.engine) or fit(shooting, *how))
    assert longest(bench.machine, forms, bench.shooting.noise, 1.0, found).form is form
    assert set(map(id, used)) == {id(form)}


def test_a_segment_that_stands_out_is_halved(bench, forms, monkeypatch) -> None:
    fit = lengths._roughly

    def stuck(shooting, *how):
        found = fit(shooting, *how)
        whole = shooting.segments.size == uncut(bench.machine).size
        level = np.where(whole & (np.arange(len(found.per_segment)) == 2), 20.0, 1.0)
        return dataclasses.replace(found, per_segment=level * shooting.segments.samples)

    monkeypatch.setattr(lengths, "_roughly", stuck)
    monkeypatch.setattr(lengths, "chained", lambda shooting, fit: fit)
    noise = bench.shooting.noise
    assert longest(bench.machine, forms, noise, 60.0).segments.size == uncut(bench.machine).size + 1
    assert not longest(bench.machine, forms, noise, 100.0).halved  # not near what is too far
    monkeypatch.setattr(lengths, "_OUT", 25.0)
    assert not longest(bench.machine, forms, noise, 60.0).halved  # not so far from the others


@pytest.mark.parametrize("touches", [True, False])
def test_states_are_sought_in_brief_pieces_where_something_touches_and_in_new_segments_alone(
    bench, forms, monkeypatch, touches: bool
) -> None:
    forms = dataclasses.replace(forms, stiff=touches, late=None)
    sought: list[int] = []
    begun, guess = lengths.begun, type(forms.coarse).starts
    monkeypatch.setattr(lengths, "begun", lambda new: sought.append(new.segments.size) or begun(new))
    monkeypatch.setattr(lengths, "chained", lambda shooting, fit: fit)  # it asks for starts too
    whole = uncut(bench.machine).size
    first = [np.arange(whole) == 0]
    monkeypatch.setattr(
        lengths, "_stands_out", lambda fit, segments, _: first.pop() if first else np.zeros(segments.size, bool)
    )
    monkeypatch.setattr(lengths, "_growth", lambda fit, segments, *_: np.zeros(segments.size))
    monkeypatch.setattr(lengths, "_loud", lambda fit, pieces, whole: np.ones(whole.size, bool))
    if not touches:
        monkeypatch.setattr(type(forms.coarse), "starts", lambda self, new: sought.append(new.size) or guess(self, new))
    found = longest(bench.machine, forms, bench.shooting.noise, 60.0)
    assert found.segments.size == whole + 1
    assert [size for size in sought if size] == [whole, 2]


@pytest.mark.parametrize("touches", [True, False])
def test_what_stands_out_where_something_touches_is_cut_shorter(touches: bool) -> None:
    machine = ram(step=0.005, soft=0.02, noise=5e-5, rows=801, push=6.0, truth=0.005 / 4)
    numerics = dataclasses.replace(Numerics.of(machine, 1), stiff=touches)
    segments = longest(machine, numerics, NoiseModel.white(np.array([5e-5])), 60.0).segments
    seconds = segments.dt[:, 0] * np.diff(segments.scored, axis=1)[:, 0]
    assert (seconds.min() < 0.19) == touches
    assert seconds.max() > 0.4


@pytest.mark.parametrize(("at", "touches", "lost"), [(0.5, False, False), (0.5, True, True), (0.3, True, False)])
def test_what_strikes_where_a_segment_is_cut_in_two_is_not_lost(
    bench, forms, monkeypatch, at: float, touches: bool, lost: bool
) -> None:
    """The initial state of the second half makes up for it; where the model strikes something, that is no sign."""
    whole, fit = uncut(bench.machine), lengths._roughly
    run, (a, b) = whole.run[2], whole.scored[2]
    row = a + int(at * (b - a))

    def struck(segments) -> np.ndarray:
        return (segments.run == run) & (segments.scored[:, 0] < row - 3) & (segments.scored[:, 1] > row + 3)

    def follow(shooting, *how):
        level = np.where(struck(shooting.segments), 20.0, 1.0)
        return dataclasses.replace(fit(shooting), per_segment=level * shooting.segments.samples)

    monkeypatch.setattr(lengths, "_roughly", follow)
    monkeypatch.setattr(lengths, "chained", lambda shooting, fit: fit)
    forms = dataclasses.replace(forms, stiff=touches)
    found = longest(bench.machine, forms, bench.shooting.noise, 60.0)
    assert found.halved
    assert struck(found.segments).sum() == (not lost)


def test_longer_segments_that_a_set_does_not_follow_are_halved(bench, monkeypatch) -> None:
    """Where it is far off, or where small errors grow; none where a simulation fails."""
    fit, known = bench.fit("viscous_friction", 0.05), bench.shooting
    whole = dataclasses.replace(known, segments=uncut(bench.machine, 2))
    same, found = followed_by(whole, known, fit)
    assert same.segments.size == whole.segments.size
    assert found.chi2 < 1.1 * same.dof
    np.testing.assert_allclose(found.values[0], bench.viscous, rtol=0.02)
    for name, bar in (("_FAR_BEHIND", 0.1), ("_GROWTH", 0.0)):
        with monkeypatch.context() as patch:
            patch.setattr(lengths, name, bar)
            assert followed_by(whole, known, fit)[0].segments.size >= 2 * whole.segments.size
    lost = dataclasses.replace(fit, values=(np.array([np.nan]),))
    assert followed_by(whole, known, lost) is None
