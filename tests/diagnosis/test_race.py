from __future__ import annotations

from torch_activegp.diagnosis.race import give_up


def test_those_far_behind_give_up_and_the_best_three_go_on() -> None:
    class Racer:
        finished = False

        def __init__(self, chi2: float, resting: object = None) -> None:
            self.chi2, self.resting = chi2, resting

    racers = [Racer(chi2) for chi2 in (99.0, 10.0, 5000.0, 30.0, 50.0, 69.0)]
    give_up(racers)
    assert [racer.finished for racer in racers] == [True, False, True, False, False, False]
    alone = [Racer(5000.0), Racer(40.0)]
    give_up(alone, [10.0, 20.0, 30.0])
    assert [racer.finished for racer in alone] == [True, False]
    give_up(alone[1:], [10.0])
    assert not alone[1].finished
    behind = [Racer(5000.0), Racer(5000.0, resting=object()), Racer(35.0, resting=object())]
    give_up(behind, [10.0, 20.0, 30.0], only_misled=True)
    assert [racer.finished for racer in behind] == [False, True, False]
