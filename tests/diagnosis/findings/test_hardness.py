from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.against_a_stop import AT, DAMPING, STIFFNESS, struck_bench
from torch_activegp.diagnosis.findings.hardness import with_hardness
from torch_activegp.diagnosis.selection.intervals import estimates
from torch_activegp.diagnosis.shooting.likelihood import Shooting

TRUE = {"position": AT, "stiffness": STIFFNESS, "damping": DAMPING}


@pytest.fixture(scope="module")
def struck():
    return struck_bench()


def fitted(struck, noise: float):
    """The stop's fit to recordings with so many times the noise."""
    stop = next(e for e in struck.effects if e.name == "joint_stop" and e.variant == "upper")
    model = dataclasses.replace(struck.shooting.noise, scale=noise * struck.shooting.noise.scale)
    position = struck.segments.position
    louder = (
        np.sqrt(noise**2 - 1.0) * struck.shooting.noise.scale * np.random.default_rng(0).normal(size=position.shape)
    )
    segments = dataclasses.replace(struck.segments, position=position + louder)
    shooting = dataclasses.replace(struck.shooting, noise=model, segments=segments)
    return shooting, shooting.fit([((stop,), (np.array([STIFFNESS, DAMPING, AT]),))], struck.nominal.starts)[0], stop


def test_an_interval_holds_what_is_harder_and_fits_as_well(struck, monkeypatch) -> None:
    """And not what fits worse, or does not spring back; each with the other parameters held."""
    shooting, fit, stop = fitted(struck, 20.0)
    own = estimates(shooting, fit, stop)
    changes = [(30.0, 1.0, 3.0), (0.01, 0.0, 5.0), (100.0, 1e5, 0.0)]  # stiffness, damping, chi2

    size = np.sqrt(np.diag(fit.information))
    alike = np.outer(size, size) * (0.99 + 0.01 * np.eye(3))  # hardly told apart

    def ends(self, sets, *_, **__):
        here = dataclasses.replace(fit.pick(np.arange(self.segments.size)), information=alike)
        values = [np.array([STIFFNESS * k, DAMPING * d, AT]) for k, d, _ in changes]
        others = [
            dataclasses.replace(here, values=(v,), chi2=here.chi2 + c[2]) for v, c in zip(values, changes, strict=True)
        ]
        return [here, *others]

    monkeypatch.setattr(Shooting, "fit", ends)
    wide = with_hardness(shooting, fit, stop, own, 1.0)
    assert {name: one.value for name, one in wide.items()} == {name: one.value for name, one in own.items()}
    assert wide["stiffness"].ci95[0] == own["stiffness"].ci95[0]
    harder = dataclasses.replace(fit, values=(np.array([30.0 * STIFFNESS, DAMPING, AT]),), information=alike)
    with_others = estimates(shooting, harder, stop)["stiffness"]
    assert 30.0 * STIFFNESS < wide["stiffness"].ci95[1] < 30.0 * STIFFNESS + 0.3 * np.ptp(with_others.ci95)
    assert wide["damping"].ci95[1] < 2.0 * DAMPING
    assert with_hardness(shooting, fit, stop, own, 2.0)["damping"].ci95[0] < own["damping"].ci95[0]  # louder noise


def test_where_recordings_tell_the_hardness_intervals_stay(struck) -> None:
    shooting, fit, stop = fitted(struck, 1.0)
    own = estimates(shooting, fit, stop)
    wide = with_hardness(shooting, fit, stop, own, 1.0)
    for name, before in own.items():
        low, high = wide[name].ci95
        assert low <= before.ci95[0]
        assert before.ci95[1] <= high
        assert high - low < 1.2 * np.ptp(before.ci95)


def test_only_segments_that_come_near_are_fitted(struck, monkeypatch) -> None:
    shooting, fit, stop = fitted(struck, 20.0)
    asked: list[Shooting] = []

    def spy(self, sets, *_, **__):
        asked.append(self)
        return [fit.pick(np.arange(self.segments.size))] * len(sets)

    monkeypatch.setattr(Shooting, "fit", spy)
    with_hardness(shooting, fit, stop, estimates(shooting, fit, stop), 1.0)
    (part,) = asked
    deepest = [
        np.where(s.counts, s.take("smooth")[..., 0], -1.0).max(axis=1) for s in (part.segments, shooting.segments)
    ]
    assert 0 < part.segments.size < shooting.segments.size
    deep = deepest[1].max() - AT
    assert deepest[0].min() > AT - 1.5 * deep
    assert (deepest[1] > AT).sum() <= part.segments.size


def test_nothing_is_fitted_for_what_is_not_struck(bench, monkeypatch) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    own = estimates(bench.shooting, fit, fit.effects[0])
    monkeypatch.setattr(Shooting, "fit", pytest.fail)
    assert with_hardness(bench.shooting, fit, fit.effects[0], own, 1.0) == own


def test_nor_where_no_segment_comes_near(struck, monkeypatch) -> None:
    shooting, fit, stop = fitted(struck, 20.0)
    away = dataclasses.replace(fit, values=(np.array([STIFFNESS, DAMPING, 5.0]),))
    own = estimates(shooting, fit, stop)
    monkeypatch.setattr(Shooting, "fit", pytest.fail)
    assert with_hardness(shooting, away, stop, own, 1.0) == own
