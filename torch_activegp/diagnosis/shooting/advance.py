"""One round of fits side by side: what they ask for is simulated together, and each is told its residuals."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.gauss_newton import Problem
from torch_activegp.diagnosis.simulation.candidate import Candidate

if TYPE_CHECKING:
    from torch_activegp.diagnosis.shooting.likelihood import Shooting

_MOST = 0.5
"""Part of the segments from which on all of them are simulated for a single candidate: sets side by side cost less than
one by one."""


def advance(shooting: Shooting, problems: Iterable[Problem], last: bool) -> None:
    """Simulates what some problems ask for, side by side where they want all segments, and tells them.

    What is moved for derivatives alone is simulated by the cheap engine where a problem takes these
    (:attr:`Problem.lent`), along with the point itself: differences count. A machine that strikes may fly apart there;
    then it is simulated as precisely as the point.

    Args:
        shooting: the likelihood.
        problems: fits on their way.
        last: whether this is their last round.
    """
    whole: list[tuple[Problem, list[Candidate], Array]] = []
    for problem in problems:
        candidates, states = problem.ask()
        if problem.only is None or (problem.only.mean() > _MOST and len(candidates) == 1):
            whole.append((problem, candidates, states))
            continue
        white = np.repeat(problem.others[None], len(candidates), axis=0)
        white[:, problem.only] = shooting.pick(problem.only).residuals_from(states[:, problem.only], candidates)
        problem.tell(white, last)
    points, moves, roughly = [], [], []
    for problem, candidates, states in whole:
        first, rough = int(problem.known is not None), problem.lent and len(candidates) > 1
        points.append((candidates[first:1], states[first:1]))
        moves.append(([] if rough else candidates[1:], states[1:]))
        roughly.append((candidates if rough else [], states))
    exact = _side_by_side(shooting, [*points, *moves])
    cheap = _side_by_side(dataclasses.replace(shooting, engine=shooting.differences), roughly)
    at = [exact[i] if some[0].known is None else some[0].known[None] for i, some in enumerate(whole)]
    failed = [_failed(*pair) for pair in zip(at, cheap, strict=True)]
    again = [(c[1:] if lost else [], s[1:]) for (_, c, s), lost in zip(whole, failed, strict=True)]
    anew = _side_by_side(shooting, again)
    for number, (problem, _, _) in enumerate(whole):
        point, there = at[number], cheap[number]
        moved = anew[number] if failed[number] else exact[len(whole) + number]
        if len(there) and not failed[number]:
            moved = point + (there[1:] - there[:1])
        problem.lent &= not failed[number]
        problem.tell(np.concatenate([point, moved]) if len(moved) else point, last)


def _failed(point: Array, there: Array) -> bool:
    """Whether some simulations failed in segments in which the one of a point did not."""
    return len(there) > 0 and not (np.isfinite(there) | ~np.isfinite(point)).all()


def _side_by_side(shooting: Shooting, wanted: Sequence[tuple[Sequence[Candidate], Array]]) -> list[Array]:
    """Whitened residuals of several groups of candidates, ``(N, S, M)`` each; of length zero where there are none."""
    candidates = [candidate for some, _ in wanted for candidate in some]
    if not candidates:
        return [np.zeros(0)] * len(wanted)
    states = np.concatenate([states for some, states in wanted if some])
    white = shooting.residuals_from(states, candidates)
    return np.split(white, np.cumsum([len(some) for some, _ in wanted])[:-1])
