"""How sets of effects compare: what they leave of the mismatch, and what their names cost."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.effect import Effect

SLACK = 8.0
MATERIAL = 0.006
"""An effect that explains less of the mismatch than this is not named: simulators differ by that much."""
OF_THE_REST = 1 / 3
"""The same part of what is left, where that is not noise."""
_INADEQUATE = 4.0
TIE = 6.0
"""Sets whose scores differ by less (odds of 20 to 1) are not told apart; any effect at all must gain so much beyond its
price, or none comes first, and more to be named."""
_UNSURE = 20.0
"""The same for any effect at all where what is left is much more than the noise: it is coloured too then, behind a
filter without phase for instance, and a single gain seems larger than it is."""
_COLOURED = 1.5
"""Where colour cannot be seen and so many times the noise is left, every name must gain that much more: behind a spring
and filtered noise at 50 Hz, 2.3 times its floor, a cogging of 108 periods a turn gained 5 beyond its price."""
_LENIENT = 0.3
_REFINED, _TOLD, _SLIGHT = 0.05, 15.0, 1e-4
"""Part of what is left above the noise, where that is little, that each further parameter of a law must explain that
contains a simpler one, the least chi2, and the least part of the mismatch. Beside right frictions wrong laws gained 4
at most in 37 such pairs, or 1e-5 of the mismatch, though simulators differed and up to 18 % more than noise was left; a
static friction that was there gained 230 of a mismatch of 500 000, and 65 where it was recorded at 50 Hz. Beside the
Coulomb friction of bristles that bend by 0.05 mrad, on a six-axis arm, a static one gained 212 of 3.1 million."""
AT_LEAST = 0.9
"""Noise per degree of freedom that any set leaves: often no closer is its level known."""
NOISE_ALONE = 1.1
"""What is left per degree of freedom where little but noise is: forms of a model and floors are off by some percent."""


@dataclasses.dataclass(frozen=True)
class Score:
    """Compares sets: chi2 in units of the noise that is left, and a price for every parameter and every name.

    Args:
        samples: number of recorded positions.
        names: number of (name, target) pairs that were tried.
        scale: variance of the noise in units of the noise model.
        mismatch: what there is to explain: the nominal's chi2 above the noise.
        free: (name, target) pairs of what seems to be tuned already: they are no names, and cost their parameters.
        hides_colour: whether noise may be filtered and nobody sees it, :attr:`Shooting.hides_colour`.
        material: part of the mismatch that a name must explain.
        corrected: whether all that compete hold the same of `free`, which costs nothing then.

    Reference: Chen, Chen, *Extended Bayesian Information Criteria for Model Selection with Large Model Spaces*,
    Biometrika 95 (2008).
    """

    samples: int
    names: int
    scale: float
    mismatch: float = 0.0
    free: frozenset[tuple[str, str]] = frozenset()
    hides_colour: bool = False
    material: float = MATERIAL
    corrected: bool = False

    def __call__(self, fit: Fit) -> float:
        """Extended BIC; smaller is better."""
        first = (_UNSURE if self.inadequate else TIE) if fit.effects else 0.0
        return fit.chi2 / self.scale + self.price(fit.effects) + first

    def without_free(self) -> Score:
        """The score where everything is a name."""
        return dataclasses.replace(self, free=frozenset(), corrected=False)

    @property
    def slack(self) -> float:
        """Sets behind the best one by less are developed too: about what one more name must gain at least."""
        return SLACK + self.least

    def before_any_fit(self, nominal: Fit) -> Score:
        """The score by the noise model, where no fit tells yet what noise is left; lenient, for it only proposes."""
        return dataclasses.replace(self, scale=1.0, mismatch=_LENIENT * max(nominal.chi2 - self.samples, 0.0))

    def seeing(self, least: float, nominal: float, dof: int) -> Score:
        """The score where a set leaves so little, and the nominal so much: noise is what is left, or what was thought.

        Args:
            least: chi2 per degree of freedom.
            nominal: chi2 of the nominal.
            dof: degrees of freedom.
        """
        scale = max(least, 1.0)
        return dataclasses.replace(self, scale=scale, mismatch=max(nominal - scale * dof, 0.0))

    def may_beat(self, effects: Sequence[Effect], best: Sequence[Effect], chi2: float, dof: int) -> bool:
        """Whether a set could score better than another one of some chi2, if it left noise alone.

        Its price is that without a name for what undoes a tuning, where something else is in it.
        """
        tunable = frozenset(effect.key for effect in effects if effect.tunable)
        lenient = self if len(tunable) == len(effects) else dataclasses.replace(self, free=self.free | tunable)
        most = max(chi2 - AT_LEAST * dof, 0.0) / self.scale + SLACK
        return lenient.price(effects) - self.price(best) < most

    def price(self, effects: Sequence[Effect]) -> float:
        """What a set must gain to be worth it.

        Further components of a vector cost no more than corrections do; further parameters of a law that contains a
        simpler one as much as these refine it.
        """
        full, refined = max(self.a_parameter, self.least), self.a_refinement
        price = 0.0
        for effect in effects:
            more = len(effect.parameters) - 1
            if effect.key in self.free:
                price += 0.0 if self.corrected else (1 + more) * self.a_parameter
            elif effect.vector:
                price += self.a_name + full + more * self.a_parameter
            else:
                price += self.a_name + full + more * (refined if effect.covers else full)
        return price

    @property
    def refines(self) -> bool:
        """Whether little but noise is left, so that what a law with more parameters gains is seen."""
        return self.scale <= NOISE_ALONE

    @property
    def a_refinement(self) -> float:
        """What a further parameter must gain by which a law contains a simpler one."""
        full = max(self.a_parameter, self.least)
        if not self.refines:
            return full
        rest = _REFINED * self.samples * (1.0 - 1.0 / self.scale)
        return min(full, max(self.a_parameter, _TOLD, rest, _SLIGHT * self.mismatch / self.scale))

    @property
    def cheapest(self) -> float:
        """What one more name with one parameter must gain."""
        return max(self.a_parameter, self.least) + self.a_name

    @property
    def a_name(self) -> float:
        """What a name must gain, its parameters apart."""
        unsure = _UNSURE if self.hides_colour and self.scale > _COLOURED else 0.0
        return max(2.0 * math.log(max(self.names, 2)), self.least) + unsure

    @property
    def least(self) -> float:
        """What is worth naming at least, half for a name and half for a parameter.

        A part of the mismatch; or of what is left, where all that was found leaves much more than noise: a nominal that
        runs away without friction makes any other finding look small.
        """
        material = 0.5 * self.material * self.mismatch / self.scale
        return min(material, 0.5 * OF_THE_REST * self.samples) if self.inadequate else material

    @property
    def inadequate(self) -> bool:
        """Whether all that was found leaves much more than noise."""
        return self.scale > _INADEQUATE

    @property
    def a_parameter(self) -> float:
        """What a parameter must gain at least."""
        return math.log(self.samples)

    def names_in(self, effects: Sequence[Effect]) -> int:
        """How many effects of a set are more than an undone tuning."""
        return sum(effect.key not in self.free for effect in effects)
