"""What no named law holds: the force that is left on each recorded joint, learned and put back."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.elimination import eliminate
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import linearize
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.force_gp import Bins, ForceGP, Remainder

_BIN = 0.04
_MOST_BINS = 3000
_FOLDS, _ROUNDS = 5, 20
"""Parts of the segments that are kept in turn, and rounds in which their initial states are fitted: after 4, those of a
planar arm left three times what they leave in the end, and a force that is right seemed to be of no use."""
_KINDS = ("one_step", "free_run")
_CLEAR, _WORTH = 10.0, 0.05
"""Chi2, and part of all beyond noise, that it must take away there. What took 0.016 of it, on a motor whose cogging is
larger than its friction, forecast held-out runs 2.6 times worse."""
_WORSE = 1.02
"""Geometric mean of the factors by which the two errors on held-out runs grow from which on a force misleads. One that
was learned where a winch's rope was slack explained 95 % of kept segments, and forecast held-out runs 1.9 times worse
by one step, 5 times freely."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What came of modelling the remainder.

    Args:
        effect: the force, or None where it does not help on data kept from its training, or misleads on held-out runs.
        details: the ``remainder`` entry of ``diagnosis.json``.
    """

    effect: Remainder | None
    details: dict[str, Any]

    def on(self, candidate: Candidate) -> Candidate:
        """A candidate with the force on top."""
        assert self.effect is not None
        return Candidate((*candidate.effects, self.effect), (*candidate.values, np.zeros(0)))

    def withheld(self, holdout: Mapping[str, Any]) -> Outcome:
        """The same without the force, and the errors on held-out runs that speak against it."""
        errors = {kind: {name: holdout[kind][name] for name in ("after", "gp")} for kind in _KINDS}
        return Outcome(None, self.details | {"used": False, "withheld": errors})

    @property
    def notes(self) -> list[str]:
        """Why the force is not used, where it is not, in a sentence."""
        if self.effect is not None:
            return []
        force = "A Gaussian process of the force that is left, over positions, velocities and controls,"
        if "withheld" not in self.details:
            return [f"{force} did not improve forecasts on data kept from its training; it is not used."]
        one, free = (self.details["withheld"][kind] for kind in _KINDS)
        return [
            f"{force} improved forecasts on data kept from its training, and not those of the held-out runs (one step "
            f"{one['gp']:.3g} for {one['after']:.3g}, free run {free['gp']:.3g} for {free['after']:.3g}): they go "
            "where it learned little. It is not used."
        ]


def model_remainder(shooting: Shooting, fit: Fit, names: Sequence[str]) -> Outcome:
    """Models the force that a fit leaves unexplained.

    Bins of 0.04 s with a free force each are eliminated to normal equations, exact for the noise of the positions; the
    GP's hyper-parameters maximise the marginal likelihood of these, on inducing points spread over the inputs.

    Args:
        shooting: the likelihood.
        fit: what is explained already.
        names: of the D inputs.

    Returns:
        The force, if it clearly lowers the chi2 of segments that it is not conditioned on (by a twentieth of what is
        beyond noise), each fifth of them in turn
        (only the hyper-parameters have seen all). A forecast over 0.1 s would hardly tell: the noise of where it starts
        outweighs most forces.

    Reference: Quinonero-Candela, Rasmussen, *A Unifying View of Sparse Approximate Gaussian Process Regression*, JMLR 6
    (2005), section 5.
    """
    part, which = _affordable(shooting)
    bins = _bins(part, fit.pick(which))
    channels = shooting.engine.channels
    learned = ForceGP.on(bins, channels)
    folds = np.arange(part.segments.size) % _FOLDS
    chi2 = np.zeros(2)
    for kept in (folds == fold for fold in np.unique(folds)):
        outcome = Outcome(learned.posterior(bins.pick(~kept)), {})
        sets = [(c.effects, c.values) for c in (fit.candidate, outcome.on(fit.candidate))]
        unseen = part.pick(kept)
        chi2 += [f.chi2 for f in unseen.fit(sets, fit.starts[which][kept], rounds=_ROUNDS, hold=True)]
    used = helps(float(chi2[0]), float(chi2[1]), part.dof)
    effect = learned.posterior(bins)
    details = {
        "used": used,
        "points": effect.points.shape[1],
        "length_scales": {
            f"joint:{joint}": dict(zip(names, map(float, scales), strict=True))
            for joint, scales in zip(channels.joints, effect.length_scales, strict=True)
        },
        "chi2_of_kept": dict(zip(("after", "gp"), _told(chi2), strict=True)),
    }
    return Outcome(effect if used else None, details)


def helps(after: float, learned: float, dof: int) -> bool:
    """Whether a learned force lowers chi2 by enough; also where without it a simulation fails, and with it none.

    Args:
        after: chi2 of kept segments without it.
        learned: and with it.
        dof: degrees of freedom.
    """
    if not math.isfinite(learned):
        return False
    return not math.isfinite(after) or after - learned > max(_CLEAR, _WORTH * (after - dof))


def misleads(holdout: Mapping[str, Any]) -> bool:
    """Whether held-out runs are forecast worse with a learned force than without, by one step and freely together.

    It learns where the machine was, and held-out runs may go elsewhere.

    Args:
        holdout: what :func:`~torch_activegp.diagnosis.findings.forecast.compare` says of ``after`` and ``gp``.
    """
    grown = [holdout[kind]["gp"] / max(holdout[kind]["after"], 1e-300) for kind in _KINDS]
    return math.prod(grown) > _WORSE**2


def _told(chi2: Array) -> list[float | None]:
    """Numbers for JSON; None where a simulation failed."""
    return [value if np.isfinite(value) else None for value in chi2.tolist()]


def _affordable(shooting: Shooting) -> tuple[Shooting, NDArray[np.int64]]:
    seconds = float(shooting.segments.dt.sum(1).mean())
    most = _MOST_BINS / (seconds / _BIN * len(shooting.engine.channels.joints))
    return shooting.subset(most / shooting.segments.size)


def _bins(shooting: Shooting, fit: Fit) -> Bins:
    segments, count = shooting.segments, len(shooting.engine.channels.joints)
    linear = linearize(shooting, fit)
    seconds = float(segments.dt.sum(1).mean())
    number = int(np.clip(round(seconds / _BIN), 1, segments.intervals))
    member = np.arange(segments.intervals) * number // segments.intervals
    held = np.broadcast_to(np.eye(number)[member], (segments.size, segments.intervals, number))
    moved = np.concatenate([linear.respond_to_force(c, held) for c in range(count)], axis=-1)
    starts = shooting.whiten_columns(linear.respond_to_start())
    result = eliminate(starts, shooting.whiten_columns(moved), shooting.residual_of(fit))
    middle = [0.5 * (x[:, 1:] + x[:, :-1]) for x in (segments.take("smooth"), segments.take("velocity"))]
    inputs = np.concatenate([*middle, shooting.engine.controls(segments, fit.candidate)], axis=-1)
    mean = np.einsum("kb,skd->sbd", held[0] / held[0].sum(0), inputs)
    shape = (segments.size, count, number)
    return Bins(mean, result.normal.reshape(*shape, count, number), result.gradient.reshape(shape))
