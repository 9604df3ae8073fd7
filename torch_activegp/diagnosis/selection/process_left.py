"""Process noise from what names leave that explain nearly all of a mismatch."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.noise.model import SEEN, NoiseModel
from torch_activegp.diagnosis.noise.process import likeliest_density
from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_LOUD = 5.0
"""Times the noise of positions that names leave at least: simulated machines never left so much behind right names."""
_NEARLY_ALL = 0.01
"""Part of the mismatch that they leave at most: what leaves more may be physics that is not on the list."""
_ANEW, _CLOSE = 5, 0.1
"""How often it is told anew at most, for names fitted by the noise of positions leave more than they must; and the part
by which it changes no more then."""
_STILL_TOLD = 10.0
"""Times what names leave that the nominal must leave by that noise too: 780 times on EMPS, 1.06 on a motor (LAAS) whose
cogging is larger than its friction. Of that all seemed to be noise, and a set that forecast worse was the best one."""
_ROUNDS = 20
"""Of a fit of initial states alone."""


def process_behind(shooting: Shooting, nominal: Fit, best: Fit) -> NoiseModel | None:
    """The noise with a white acceleration of joints on which names leave much, though next to nothing of a mismatch.

    No law is all of a real machine. On a drive (EMPS) the right names left 60 times the noise of its encoder, half a
    thousandth of the mismatch. Weighed as noise of positions, that moved parameters by 2 to 7 % from its authors', and
    a static friction that is not there seemed certain; as a random force, for which inverse dynamics by least squares
    takes it, by 1 to 3 %, and nothing else gained.

    Joints behind a filter keep their noise as it is.

    Args:
        shooting: the likelihood.
        nominal: the fit without names.
        best: the best set.

    Returns:
        The noise, or None where names leave little, or too much: of the mismatch, or of forces; where there is none, or
        as many as are tried.
    """
    if not 0 < len(best.effects) < MAX_EFFECTS:
        return None
    joints = _much_left(shooting, nominal, best)
    if not joints.any():
        return None
    density, working, fit = np.zeros(len(joints)), shooting, best.without_derivatives
    for _ in range(_ANEW):
        before, density = density, _likeliest(shooting, fit, joints)
        if not density.any():
            return None
        working = dataclasses.replace(shooting, noise=dataclasses.replace(shooting.noise, process=density))
        fit = working.fit([(fit.effects, fit.values)], fit.starts)[0]
        if np.allclose(density, before, _CLOSE):
            break
    bare = working.fit([((), ())], nominal.starts)[0]
    return working.noise if bare.chi2 > _STILL_TOLD * fit.chi2 else None


def by_positions(shooting: Shooting, fit: Fit) -> tuple[Shooting, Fit]:
    """A likelihood and a fit by the noise of positions alone, with initial states of its own."""
    if shooting.noise.process is None:
        return shooting, fit
    alone = dataclasses.replace(shooting, noise=shooting.noise.of_positions)
    return alone, alone.fit([(fit.effects, fit.values)], fit.starts, _ROUNDS, hold=True)[0]


def _much_left(shooting: Shooting, nominal: Fit, best: Fit) -> NDArray[np.bool_]:
    """Channels in which a set leaves much, though next to nothing of what the nominal leaves, ``(C,)``."""
    channels = shooting.segments.position.shape[-1]
    before, after = (
        (shooting.residual_of(fit).reshape(-1, channels) ** 2).sum(axis=0) * channels / shooting.dof - 1.0
        for fit in (nominal, best)
    )
    white = ~shooting.noise.colour.any(axis=1)
    return np.asarray(white & (after > _LOUD - 1.0) & (after < _NEARLY_ALL * before))


def _likeliest(shooting: Shooting, fit: Fit, joints: NDArray[np.bool_]) -> Array:
    """The likeliest density of what a fit leaves on joints, ``(C,)``; 0 where that is noise, or a simulation fails."""
    density = np.zeros(len(joints))
    left = shooting.measured - shooting.predicted(fit)
    if not np.isfinite(left[shooting.segments.counts]).all():
        return density
    for channel in np.flatnonzero(joints):
        scale = float(shooting.noise.scale[channel])
        found, gain = likeliest_density(shooting.segments, left[..., channel], scale)
        density[channel] = found if gain > SEEN else 0.0
    return density
