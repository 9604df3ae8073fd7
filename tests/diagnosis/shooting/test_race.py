from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.point import Point
from torch_activegp.diagnosis.shooting.race import Race, reach
from torch_activegp.diagnosis.shooting.score import Score


class Racer:
    """A fit on its way."""

    def __init__(self, chi2: float, resting: object = None, effects=None, values=(), at_rest: bool = False) -> None:
        self.chi2, self.resting, self.values, self.at_rest = chi2, resting, values, at_rest
        self.effects = (object(),) if effects is None else effects
        self.best = Point(np.concatenate([np.zeros(0), *values]), np.zeros((1, 2)), np.array([chi2]))
        self.finished = self.waits = False


@pytest.mark.parametrize(("best", "worst", "most"), [(100.0, 200.0, 160.0), (100.0, 2100.0, 300.0), (50.0, 1e6, 250.0)])
def test_how_far_behind_goes_on(best: float, worst: float, most: float) -> None:
    """60 at least, a tenth of what lies between, four times the best at most."""
    assert reach(best, worst) == pytest.approx(most)


def test_those_far_behind_give_up_and_the_best_three_go_on() -> None:
    racers = [Racer(chi2) for chi2 in (99.0, 10.0, 5000.0, 30.0, 50.0, 69.0)]
    Race().give_up(racers)
    assert [racer.finished for racer in racers] == [True, False, True, False, False, False]
    alone = [Racer(5000.0), Racer(40.0)]
    Race().give_up(alone, [Racer(10.0), Racer(20.0), Racer(30.0)])
    assert [racer.finished for racer in alone] == [True, False]
    Race().give_up(alone[1:], [Racer(10.0)])
    assert not alone[1].finished
    behind = [Racer(5000.0), Racer(5000.0, resting=object()), Racer(35.0, resting=object())]
    Race().give_up(behind, [Racer(10.0), Racer(20.0), Racer(30.0)], only_misled=True)
    assert [racer.finished for racer in behind] == [False, True, False]


def test_a_set_that_began_from_several_first_guesses_takes_one_place() -> None:
    many, other, late = ("stop",), Racer(20.0), Racer(5000.0)
    Race().give_up([*(Racer(10.0, effects=many) for _ in range(3)), other, late])
    assert not late.finished
    Race().give_up([Racer(10.0, effects=many), other, late], [Racer(30.0)])
    assert late.finished
    same = [Racer(chi2, effects=many) for chi2 in (10.0, 20.0, 30.0, 5000.0, 6000.0)]
    Race().give_up(same)
    assert [racer.finished for racer in same] == [False, False, False, True, True]


def test_where_all_fail_none_is_far_behind() -> None:
    racers = [Racer(np.inf) for _ in range(5)]
    with np.errstate(invalid="raise"):
        Race().give_up(racers)
    assert not any(racer.finished for racer in racers)


@pytest.mark.parametrize(
    ("best", "change", "given_up"),
    [
        (1.02, {}, True),
        (1.3, {}, False),  # there is more than noise left to explain
        (1.02, {"score": None}, False),
        (1.02, {"free": True}, False),
        (1.02, {"only_misled": True}, False),
        (1.02, {"nominal": 1.5}, False),  # where there is little to explain, names are cheap
    ],
)
@pytest.mark.parametrize("ended", [True, False])
def test_those_that_cost_too_much_beside_one_that_leaves_noise_alone_give_up(
    bench, best: float, change: dict, given_up: bool, ended: bool
) -> None:
    """A stop costs more than 1 % of the mismatch: even noise alone would not be worth it."""
    damping, stop, drag = (bench.effect(name) for name in ("viscous_friction", "joint_stop", "quadratic_drag"))
    score = Score(1000, 20, 1.0, free=frozenset({damping.key} if change.get("free") else ()))
    race = Race(change.get("score", score), change.get("nominal", 25.0) * 1000, 1000)
    first = Racer(best * 1000, None, (damping,), (np.array([0.05]),))
    dear = Racer(best * 1000 + 40, None, (damping, stop), (np.array([0.05]), np.array([0.5, 100.0, 1.0])))
    rival = Racer(best * 1000 + 50, None, (drag,), (np.array([0.01]),))
    running = [dear, rival, *([] if ended else [first])]
    race.give_up(running, [first] if ended else [], only_misled=change.get("only_misled", False))
    assert dear.finished == given_up
    assert not rival.finished
    assert not first.finished


def test_what_no_machine_can_have_makes_nothing_dear(bench) -> None:
    stribeck, drag, stop = (bench.effect(name) for name in ("stribeck_friction", "quadratic_drag", "joint_stop"))
    odd = Racer(1000.0, None, (stribeck,), (np.array([0.0, 0.3, 0.2]),))
    dear = Racer(1040.0, None, (drag, stop), (np.array([0.01]), np.array([0.5, 100.0, 1.0])))
    Race(Score(1000, 20, 1.0), 25e3, 1000).give_up([odd, dear])
    assert not dear.finished
    resting = Racer(1000.0, None, (drag,), (np.array([0.01]),), at_rest=True)
    Race(Score(1000, 20, 1.0), 25e3, 1000).give_up([dear], [resting])
    assert not dear.finished


def test_what_may_undo_a_tuning_counts_without_its_name(bench) -> None:
    damping, bias, drag = (bench.effect(name) for name in ("viscous_friction", "constant_force", "quadratic_drag"))
    score = Score(1000, 20, 1.0).seeing(0.9, 80e3, 1000)
    assert (score.scale, score.mismatch) == (1.0, 79e3)
    assert damping.tunable
    assert bias.tunable
    assert score.may_beat((drag, damping, bias), (drag,), 1050.0, 1000)
    assert not score.may_beat((damping, bias), (drag,), 1050.0, 1000)
    assert score.may_beat((damping, bias), (drag,), 1950.0, 1000)


def test_one_whose_states_are_still_sought_is_not_given_up() -> None:
    racers = [Racer(chi2) for chi2 in (10.0, 20.0, 30.0, 5000.0, 6000.0)]
    racers[3].waits = True
    Race().give_up(racers)
    assert [racer.finished for racer in racers] == [False, False, False, False, True]
