"""Process noise from what names leave that explain nearly all of a mismatch."""

from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.noise.model import SEEN, NoiseModel
from torch_activegp.diagnosis.noise.process import likeliest_process
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_LOUD = 5.0
"""Times the noise of positions that names leave at least: simulated machines never left so much behind right names."""
_NEARLY_ALL = 0.01
"""Part of the mismatch that they leave at most: what leaves more may be physics that is not on the list."""
_ROUNDS = 20
_STILL_TOLD = 10.0
"""Times what names leave that the nominal must leave by that noise too: 780 times on EMPS, 1.06 on a motor (LAAS) whose
cogging is larger than its friction. Of that all seemed to be noise, and a set that forecast worse was the best one."""
_ANEW, _CLOSE = 5, 0.1
"""How often it is told anew at most, for names fitted by the noise of positions leave more than they must; and the part
by which it changes no more then."""


def process_behind(shooting: Shooting, nominal: Fit, best: Fit) -> NoiseModel | None:
    """The noise with a white acceleration of each joint, where names leave much, though next to nothing of a mismatch.

    No law is all of a real machine. On a drive (EMPS) the right names left 60 times the noise of its encoder, half a
    thousandth of the mismatch. Weighed as noise of positions, what was left moved parameters by 5 to 7 % from those of
    its authors, and a static friction that is not there seemed certain; as a white force, for which inverse dynamics by
    least squares takes it, by 1 %, and nothing else gained.

    Args:
        shooting: the likelihood.
        nominal: the fit without names.
        best: the best set.

    Returns:
        The noise, or None where names leave little, or too much: of the mismatch, or of forces.
    """
    beyond = best.chi2 - shooting.dof
    if not best.effects or best.chi2 < _LOUD * shooting.dof or beyond > _NEARLY_ALL * (nominal.chi2 - shooting.dof):
        return None
    noise, fit = None, best.without_derivatives
    for _ in range(_ANEW):
        before, noise = noise, _likeliest(shooting, fit) or noise
        if noise is None or (before is not None and _alike(before, noise)):
            break
        again = dataclasses.replace(shooting, noise=noise)
        fit = again.fit([(fit.effects, fit.values)], fit.starts)[0]
    if noise is None:
        return None
    bare = dataclasses.replace(shooting, noise=noise).fit([((), ())], nominal.starts)[0]
    return noise if bare.chi2 > _STILL_TOLD * fit.chi2 else None


def by_positions(shooting: Shooting, fit: Fit) -> tuple[Shooting, Fit]:
    """A likelihood and a fit by the noise of positions alone, with initial states of its own."""
    if shooting.noise.process is None:
        return shooting, fit
    alone = dataclasses.replace(shooting, noise=shooting.noise.of_positions)
    return alone, alone.fit([(fit.effects, fit.values)], fit.starts, _ROUNDS, hold=True)[0]


def _alike(one: NoiseModel, other: NoiseModel) -> bool:
    """Whether two noises have about the same accelerations."""
    return one.process is not None and other.process is not None and np.allclose(one.process, other.process, _CLOSE)


def _likeliest(shooting: Shooting, fit: Fit) -> NoiseModel | None:
    """The likeliest noise of what a fit leaves; None where it is that of positions alone, or the simulation fails."""
    offset = 0.0 if shooting.offset is None else shooting.offset
    left = shooting.segments.position - offset - shooting.predicted(fit)
    if not np.isfinite(left[shooting.segments.counts]).all():
        return None
    least = shooting.noise.innovation
    told = [likeliest_process(shooting.segments, left[..., c], float(each)) for c, each in enumerate(least)]
    if max(each.gain for each in told) < SEEN:
        return None
    density = np.array([each.density if each.gain > SEEN else 0.0 for each in told])
    scale = np.where(density > 0.0, [each.scale for each in told], shooting.noise.scale)
    return dataclasses.replace(shooting.noise, scale=scale, process=density)
