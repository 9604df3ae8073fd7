from __future__ import annotations

import pytest

from torch_activegp.diagnosis.compared import Selection
from torch_activegp.diagnosis.result import EffectStability, Stability
from torch_activegp.diagnosis.score import Score
from torch_activegp.diagnosis.verdict import decide


@pytest.fixture
def selection(bench) -> Selection:
    fits = [bench.nominal, bench.fit("viscous_friction", 0.05), bench.fit("coulomb_friction", 0.01)]
    return Selection(bench.nominal, fits, Score(bench.shooting.samples, 60, 1.0))


def test_a_name_that_forecasts_what_was_left_out_stays(bench, selection) -> None:
    judgement, stable, same = decide(bench.shooting, selection)
    assert [effect.name for effect in judgement.named] == ["viscous_friction"]
    assert stable is not None
    assert not stable.effects[0].refuted
    assert same is selection


def test_a_refuted_name_makes_way_for_the_next_best_set(bench, selection, monkeypatch) -> None:
    """The recordings left out are said to be worse for friction by the speed; dry friction comes next, and is not."""

    def said(shooting, selection, judgement) -> Stability:
        gains = {"viscous_friction": (4.0, -20.0), "coulomb_friction": (4.0, 20.0)}
        effects = [EffectStability(e.name, e.target, gains[e.name], (), {}) for e in judgement.named]
        return Stability(("a", "b"), tuple(effects), "said", True)

    monkeypatch.setattr("torch_activegp.diagnosis.verdict.stability", said)
    judgement, _, left = decide(bench.shooting, selection)
    assert judgement.fit.keys == {("coulomb_friction", "joint:hip")}
    assert [fit.keys for fit in left.fits] == [frozenset(), judgement.fit.keys]


@pytest.mark.parametrize(
    ("gains", "refuted"),
    [
        ((5.0, -15.0, None), True),
        ((20.0, -15.0), False),  # as a whole it forecasts better
        ((-3.0, -4.0), False),  # no more than chance
        ((None, None), False),  # it acts in one recording alone
    ],
)
def test_what_refutes_a_name(gains, refuted: bool) -> None:
    assert EffectStability("cogging", "joint:hip", gains, (), {}).refuted is refuted
