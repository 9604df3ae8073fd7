"""Which integrator and time step: a difference of discretisation must not become an effect."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.agreement import bar, cheaper, first_close, just, settled, unabsorbed
from torch_activegp.diagnosis.preparation.brief_pieces import left_in_brief
from torch_activegp.diagnosis.preparation.late import (
    Sets,
    like_few_steps,
    otherwise_late,
    without_delays,
    without_half_steps,
)
from torch_activegp.diagnosis.preparation.own_forms import DISCRETE, MUCH, NO_FARTHER, own_rivals
from torch_activegp.diagnosis.preparation.rivals import Rival, distinct, too_far
from torch_activegp.diagnosis.preparation.telling import CREEPS, enough, telling
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import LENDS, Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE
from torch_activegp.diagnosis.simulation.calm import is_abrupt
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.forms import Forms

_PRICE = 20.0
_FINEST = 2.0
"""Chi2 by which shorter steps must fit better: they cost time alone."""
_CLEARLY = 0.25
"""Where more than :data:`MUCH` times the noise is left, another form than the model's own must fit better by so much of
it: one form or the other absorbs some of what is missing by chance."""
_NEAR, _LOST = 2.0, 4.0
"""Where a form leaves less than so many times the noise, others that leave so many times as much are given up."""
_SPARE = 1.05
"""Where something touches and a form leaves less than so many times the noise, its own integrator in shorter steps is
not asked: a hopper's steps of 1 ms left 1.18, half of them 1.09, and 1.02 those of 0.2 ms that it was made in."""
_GAINS = 0.01
"""Part of its chi2 by which one of these must be closer than what came before, or the others are not fitted: on a leg
on a floor eight forms left 20 to 27 times the noise, and 1.09 to 1.13 behind its friction and a limit."""
_ABOUT = 1.2
"""Where the fine form leaves at most so many times what the closest one does before they are fitted, it comes first."""

Known = tuple[Engine, Shooting]


class Numerics(Forms):
    """Chooses among the forms of a model.

    A truth that is integrated more finely than the model looks as if its control came half a time step late. So the
    model as it is competes with the model nearly continuous in time, before anything is named; and while sets are
    compared, a coarse form stands for either, with its error taken out (:meth:`Shooting.corrected`).
    """

    def choose(
        self,
        segments: Segments,
        noise: NoiseModel,
        near: Fit,
        nominal: Fit,
        sets: Sets = (),
        known: Known | None = None,
        only: Engine | None = None,
    ) -> tuple[Engine, Shooting, Fit, Fit]:
        """Takes the form under which the first of some sets, or the nominal, fits better.

        Args:
            segments: S segments.
            noise: of the recordings.
            near: a fit to these segments to begin from.
            nominal: a fit of the nominal model to begin from.
            sets: effects and first guesses; the nominal model where there are none.
            known: an engine under which ``near`` is the fit of the first set already, and its likelihood.
            only: the form that was taken behind the set already, where only the segments are others.

        Returns:
            The precise engine; the likelihood to compare sets with, over fewer segments where these tell enough; the
            nominal's fit; the first set's.
        """
        loud = known is not None and near.chi2 > NOISE_ALONE * known[1].dof
        whole = Shooting(self.coarse, segments, noise)
        competing = self._forms(segments, sets[:1], known, loud)
        longest = max(competing, key=lambda form: form.steps_in(segments))
        first, which = whole.subset(enough(longest, segments))
        rough = self._rough(first, near.pick(which), sets[:1])
        trials = [*without_delays(sets[:1]), *otherwise_late(sets)]
        rivals = [Rival.at(first, only, rough)] if only is not None else []
        if not rivals or not np.isfinite(rivals[0].left):
            rivals = self._rivals(competing, first, rough)
        engine, working, judged = self._race(rivals, first, rough, trials, whole.dof, known)
        if known is not None and engine is known[0] and judged.effects == near.effects:
            return *known, nominal, near
        if first.segments.size < segments.size:
            part = telling(whole, working, nominal, nominal.pick(which))
            near, nominal = near.beginning(which, judged.starts).pick(part), nominal.pick(part)
            if not np.array_equal(part, which):
                begin = dataclasses.replace(near, effects=judged.effects, values=judged.values, columns=None)
                working = dataclasses.replace(whole.pick(part), engine=working.engine)
                working, judged = self._on_all(working, engine, begin)
        bare = working.fit([((), ())], nominal.starts, CREEPS, near=nominal)[0] if sets else judged
        if sets and self.stiff:
            precise = dataclasses.replace(working, engine=engine, cheap=self.coarse, offset=None)
            working, bare, judged = just(working, precise, nominal, bare, judged)
        return engine, working, bare, judged

    def _rough(self, first: Shooting, here: Fit, sets: Sets) -> Fit:
        """A fit of a set, where there is one, by the first cheap form that can; with derivatives."""
        fit = here
        if sets and tuple(sets[0][0]) != here.effects:
            for cheap in dict.fromkeys((self.coarse, self.middle, self.given)):
                fit = dataclasses.replace(first, engine=cheap).fit(sets, here.starts, near=here)[0]
                if np.isfinite(fit.chi2):
                    break
        return fit if fit.design is not None else first.fit([(fit.effects, fit.values)], fit.starts, hold=True)[0]

    def _race(
        self,
        rivals: Sequence[Rival],
        first: Shooting,
        rough: Fit,
        trials: Sets,
        dof: int,
        known: Known | None = None,
    ) -> tuple[Engine, Shooting, Fit]:
        """The precise form under which a set, or one of some others, fits best; likelihood and fit.

        Args:
            rivals: the forms.
            first: the likelihood on a part of the segments.
            rough: a fit of the set there.
            trials: what may do as well as the set.
            dof: of all segments.
            known: as in `choose`.
        """
        results: list[tuple[float, Engine, Shooting, Fit, float]] = []
        share, least, begin, vain = first.dof / dof, np.inf, rough, False
        rivals = sorted(rivals, key=lambda one: self._dear(one.engine, first, known))
        strikes = self.stiff or any(e.name == "joint_stop" for e in rough.effects)
        smooth = not strikes and not any(is_abrupt(e) for e in rough.effects)
        if not strikes:  # what does ends elsewhere by forms that are alike
            rivals = distinct(rivals, first, rough, not smooth)
        close = _ABOUT * min(rival.left for rival in rivals)
        may_skip = smooth and not like_few_steps(rough.effects, rough.values, self._fine_step(first.segments))
        spare = self.own if self.stiff else ()  # so alike where something touches that all of them would be fitted

        def turn(one: Rival) -> tuple[bool, bool, float]:
            return one.engine in spare, one.engine is not self.fine or one.left > close, one.left

        for rival in sorted(rivals, key=turn):
            lost = _LOST * least if least < _NEAR * first.dof else np.inf
            expected = self._cost(rival.engine, rough, rival.least / share, dof)
            if (vain or least < _SPARE * first.dof) and rival.engine in spare:
                continue
            much = rival.engine is self.given or bool(rough.effects)
            if least < NOISE_ALONE * first.dof and may_skip and expected > too_far(results, much):
                continue
            working, judged = self._working(rival, first, begin, lost)
            vain = rival.engine in spare and (1.0 - _GAINS) * least < judged.chi2 < np.inf
            if judged.chi2 > lost:
                continue
            if self.stiff and judged.chi2 < min(least, _NEAR * first.dof):  # farther off, what comes later seems closer
                begin = judged
            least = min(least, judged.chi2)
            others = working.fit(trials, judged.starts, near=judged) if trials else []
            best = min([judged, *others], key=lambda fit: fit.chi2 / share + _PRICE * fit.size)
            cost = self._cost(rival.engine, best, best.chi2 / share, dof)
            results.append((cost, rival.engine, working, best, expected))
        return self._own_behind(*min(results, key=lambda result: result[0])[:4], first, dof)

    def _own_behind(
        self, cost: float, engine: Engine, working: Shooting, judged: Fit, first: Shooting, dof: int
    ) -> tuple[Engine, Shooting, Fit]:
        """What won, or the model's own integrator in shorter steps where that comes closer behind names.

        Far from them, before they are fitted, all forms seem as far off: behind a spring on a gimbal Runge-Kutta left
        2.4 times the noise, and the integrator that had made the data had left no less than it at first sight. Names
        that may stand for a time step are left out first.
        """
        own = [form for form in self.own if form is not engine]
        if self.stiff or not own or not judged.effects:
            return engine, working, judged
        step = float(np.median(first.segments.dt)) / self.given.substeps
        sets = without_half_steps([(judged.effects, judged.values)], self.given.model, step)
        begins = [working.fit(sets, judged.starts, near=judged)[0]] if sets else []
        begins += [judged] if judged.chi2 >= NOISE_ALONE * first.dof else []
        for begin in begins:
            here = self._rough(first, begin, ())
            rivals = [Rival.at(first, form, here) for form in dict.fromkeys((engine, self.fine))]
            for rival in own_rivals(self, own, first, here, rivals):
                promised = self._cost(rival.engine, begin, rival.least * dof / first.dof, dof)
                vain = here.columns is not None and promised > too_far([(cost, cost)], much=True)
                if rival.left < (1.0 - DISCRETE) * rivals[0].left and not vain:
                    closer, fit = self._working(rival, first, here, np.inf)
                    if self._cost(rival.engine, fit, fit.chi2 * dof / first.dof, dof) < cost:
                        return rival.engine, closer, fit
        return engine, working, judged

    def _dear(self, engine: Engine, first: Shooting, known: Known | None) -> tuple[bool, bool, float]:
        """Of forms that nothing tells apart the least is taken: the one before, then the fine one, then the cheap."""
        return known is None or engine is not known[0], engine is not self.fine, engine.steps_in(first.segments)

    def _rivals(self, competing: Sequence[Engine], first: Shooting, rough: Fit) -> list[Rival]:
        """The forms to fit.

        Where something touches, those that come close in brief pieces. Else those that compete, and the model's own
        integrator in steps that come closest, where no other form is closer by far.
        """
        own = [form for form in self.own if form not in competing]
        if self.stiff:
            leaves = {form: left_in_brief(first, form, rough) for form in (*competing, *own)}
            near = [form for form, chi2 in leaves.items() if chi2 <= NO_FARTHER * min(leaves.values())]
            return [dataclasses.replace(Rival.at(first, form, rough), left=leaves[form]) for form in near]
        rivals = [Rival.at(first, form, rough) for form in competing]
        return rivals + own_rivals(self, own, first, rough, rivals) if own else rivals

    def _cost(self, engine: Engine, fit: Fit, chi2: float, dof: int) -> float:
        """What a fit leaves, with what its parameters and its form must be worth."""
        price = _PRICE * fit.size + (_FINEST if engine in (*self.short, *self.own) else 0.0)
        if engine in (self.given, *self.own) and engine is not self.fine:
            price += DISCRETE * chi2
        much = max(chi2 - MUCH * dof, 0.0)
        return chi2 + price + (0.0 if engine is self.given else _CLEARLY * much)

    def _forms(self, segments: Segments, sets: Sets, known: Known | None, loud: bool = False) -> list[Engine]:
        """The precise forms that compete behind a set; the one that was taken before is among them.

        Where that leaves more than the noise, those with short steps are too: MuJoCo's dry friction creeps in long
        ones, and was found 2 % off by two integrators in steps of 5 ms or of first order.
        """
        held = any(effect.needs_steps for effects, _ in sets for effect in effects)
        short = loud or held or any(like_few_steps(*some, self._fine_step(segments)) for some in sets)
        shorter = (self.finest, self.leapt) if short else ()
        forms = (self.given, self.fine, self.firm, self.firm_leapt, *(known[:1] if known else ()), *shorter)
        return [form for form in dict.fromkeys(forms) if form is not None]

    def _fine_step(self, segments: Segments) -> float:
        return float(np.median(segments.dt)) / self.fine.substeps

    def _working(self, rival: Rival, first: Shooting, rough: Fit, lost: float) -> tuple[Shooting, Fit]:
        """The cheapest form that stays close to an engine, corrected by it.

        Where something touches, a correction holds for the instants of touching alone that it was made for; there a
        form must reach the fit that the engine itself reaches, from there.
        """
        engine = rival.engine
        precise = dataclasses.replace(first, engine=engine, cheap=self.coarse)
        forms = self._cheap_ones(rival, precise, rough)
        rest = self._may_stick(rough)
        if not self.stiff:
            return first_close(precise, forms, rough, None, rival.exact, lost, rest=rest)
        exact = settled(precise, engine, rough, None, lost, rest)[1]
        if exact.chi2 > lost or not np.isfinite(exact.chi2):
            return precise, exact
        return first_close(precise, forms, exact, exact, lost=lost, rest=rest)

    def _on_all(self, working: Shooting, engine: Engine, begin: Fit) -> tuple[Shooting, Fit]:
        """The form that was found on a part of the segments, and the fit to all of them; see :meth:`_working`."""
        precise = dataclasses.replace(working, engine=engine, cheap=self.coarse)
        close = working.engine
        forms = cheaper((close, self.stand_in(engine)), engine, working.segments)
        rest = self._may_stick(begin)
        if not self.stiff:
            return first_close(precise, forms, begin, None, known=close, rest=rest)
        # from where the form ends that is known to be close, which costs less
        led = begin
        if close is not engine:
            led = settled(dataclasses.replace(precise, engine=close), engine, begin, rest=rest)[1]
        tried = [led, begin] if np.isfinite(led.chi2) and led is not begin else [begin]
        ends = (settled(precise, engine, some, rest=rest)[1] for some in tried)
        exact = next((fit for fit in ends if np.isfinite(fit.chi2)), None)
        return (precise, begin) if exact is None else first_close(precise, forms, exact, exact, known=close, rest=rest)

    def _cheap_ones(self, rival: Rival, precise: Shooting, rough: Fit) -> list[Engine]:
        """What may stand in for an engine, the engine itself last: first the cheapest that is close where they begin.

        On a stiff machine, where nothing is close before it is fitted, from the cheapest on. Elsewhere Runge-Kutta in
        few steps may stand for a scheme of first order in many: on an arm of seven, 4 evaluations a row for 16.
        """
        steps, own = (form.steps_in(precise.segments) for form in (self.middle, rival.engine))
        dearer = () if self.stiff or LENDS * steps > own else (self.middle,)
        some = (self.coarse, self.late or self.coarse, *dearer, self.stand_in(rival.engine))
        cheap = cheaper(some, rival.engine, precise.segments)
        if self.stiff or len(cheap) < 3:
            return cheap
        most = bar(precise, rough)

        def far(engine: Engine) -> float:
            working = dataclasses.replace(precise, engine=engine).corrected(rival.engine, rough, rival.exact)
            error = unabsorbed(working, rough) if working.offset is not None else most
            return error if error >= most else 0.0

        return [*sorted(cheap[:-1], key=far), cheap[-1]]

    def _may_stick(self, fit: Fit) -> bool:
        """Whether a joint may be held as a segment begins. Where something touches, rest was tried as it was cut."""
        return any(map(is_abrupt, fit.effects)) or (not self.stiff and self.given.model.dof_frictionloss.any())
