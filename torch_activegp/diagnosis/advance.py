"""One round of fits side by side: what they ask for is simulated together, and each is told its residuals."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from torch_activegp.diagnosis.candidate import Candidate
from torch_activegp.diagnosis.gauss_newton import Problem
from torch_activegp.diagnosis.runs import Array

if TYPE_CHECKING:
    from torch_activegp.diagnosis.shooting import Shooting

_MOST = 0.5
"""Part of the segments from which on all of them are simulated: sets side by side cost less than one by one."""


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
        if problem.only is None or problem.only.mean() > _MOST:
            whole.append((problem, candidates, states))
            continue
        white = problem.others[None].copy()
        white[:, problem.only] = shooting.pick(problem.only).residuals_from(states[:, problem.only], candidates)
        problem.tell(white, last)
    points, moves, roughly = [], [], []
    for problem, candidates, states in whole:
        known, rough = problem.known is not None, problem.lent and len(candidates) > 1
        points.append((candidates[known:1], states[known:1]))
        moves.append((candidates[1:], states[1:]) if not rough else ([], states[:0]))
        roughly.append((candidates, states) if rough else ([], states[:0]))
    exact = _side_by_side(shooting, [*points, *moves])
    cheap = _side_by_side(dataclasses.replace(shooting, engine=shooting.differences), roughly)
    for number, (problem, candidates, states) in enumerate(whole):
        point = exact[number] if problem.known is None else problem.known[None]
        moved, there = exact[len(whole) + number], cheap[number]
        if len(there) and np.isfinite(there).all():
            moved = point + (there[1:] - there[:1])
        elif len(there):
            problem.lent = False
            moved = shooting.residuals_from(states[1:], candidates[1:])
        problem.tell(np.concatenate([point, moved]) if len(moved) else point, last)


def _side_by_side(shooting: Shooting, wanted: Sequence[tuple[Sequence[Candidate], Array]]) -> list[Array]:
    """Whitened residuals of several groups of candidates, ``(N, S, M)`` each; of length zero where there are none."""
    candidates = [candidate for some, _ in wanted for candidate in some]
    if not candidates:
        return [np.zeros(0)] * len(wanted)
    white = shooting.residuals_from(np.concatenate([states for _, states in wanted]), candidates)
    return np.split(white, np.cumsum([len(some) for some, _ in wanted])[:-1])
