"""Which integrator and time step: a difference of discretisation must not become an effect."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from torch_activegp.diagnosis.chaining import chained
from torch_activegp.diagnosis.engine import IMPLICIT_FAST, Engine, begin_drives, substeps_for
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.leapfrog import is_of_second_order
from torch_activegp.diagnosis.machine import Machine
from torch_activegp.diagnosis.noise_model import NoiseModel
from torch_activegp.diagnosis.prescribed_motion import RUNGE_KUTTA
from torch_activegp.diagnosis.runs import Array, median_step
from torch_activegp.diagnosis.segments import Segments
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.friction import sticking

_STEP = 0.005
_STIFF_STEP = 0.001
_EFFECT_STEP, _HELD_STEP = 0.0005, 0.00125
"""An effect that is a force is held in each time step: a stop or a play that acts for milliseconds wants short ones,
and friction sticks as firmly as two of them allow. Leapfrog in the first is more exact than Runge-Kutta in the second
where it is of second order: 1.1 per dof for 2.4 where a joint sticks and slips at 0.3 mrad."""
_FIRM_STEP = 0.00025
"""For friction of the model's own: a joint that sticks and slips at 0.05 mrad noise left 2.3 per dof with Runge-Kutta
in steps of 0.5 ms, and 0.89, as the noise alone, with leapfrog in half of that."""
_QUICK = 0.00125
_CLOSE = 30.0
_ROUGHLY = 0.1
"""Where a fit leaves much more than the noise, an error of so much of what it leaves is close too."""
_PRICE = 20.0
_FINEST = 2.0
"""Chi2 by which shorter steps must fit better: they cost time alone."""
_JUDGES = 16
_PART = 0.25
"""Forms are compared on so many of the segments, or this part of them."""
_MUCH, _CLEARLY = 2.0, 0.25
"""Where more than this times the noise is left, another form than the model's own must fit better by so much of it:
one form or the other absorbs some of what is missing by chance."""
_SETTLED = 0.01
_SAME = 0.02
_POSES = 300
_TOUCHING = 0.01
"""Contact in fewer poses is an accident of noise or of shapes drawn too large."""
_LIKE_A_TIME_STEP = frozenset({"actuator_delay", "actuator_lag", "sensor_delay"})


def _touching(machine: Machine) -> float:
    """The part of the recorded poses in which something touches, or a joint is at its limit."""
    model, channels = machine.model, machine.channels
    data = mujoco.MjData(model)
    seen = touching = 0
    for run in (*machine.fit, *machine.holdout):
        for row in range(0, len(run), max(len(run) // _POSES, 1)):
            data.qpos[:] = model.qpos0
            data.qpos[channels.qpos] = run.smooth[row]
            if channels.prescribed is not None and run.prescribed is not None:
                data.qpos[channels.prescribed.qpos] = run.prescribed.smooth[row]
            mujoco.mj_fwdPosition(model, data)
            seen += 1
            touching += bool(data.ncon or data.nl)
    return touching / max(seen, 1)


def _steps(interval: float, longest: float) -> int:
    """Time steps in an interval, of some length at most."""
    return max(int(np.ceil(interval / longest - 1e-6)), 1)


def _cheap(model: mujoco.MjModel) -> int:
    """The model's integrator, or the implicit one in place of Runge-Kutta's four evaluations."""
    runge_kutta = model.opt.integrator == RUNGE_KUTTA
    return IMPLICIT_FAST if runge_kutta else int(model.opt.integrator)


Sets = Sequence[tuple[Sequence[Effect], Sequence[Array]]]
Known = tuple[Engine, Shooting]


def _without_delays(sets: Sets) -> list[tuple[tuple[Effect, ...], tuple[Array, ...]]]:
    """The same sets without what a wrong time step looks like."""
    out = []
    for effects, values in sets:
        kept = [(e, v) for e, v in zip(effects, values, strict=True) if e.name not in _LIKE_A_TIME_STEP]
        if len(kept) < len(effects):
            out.append((tuple(e for e, _ in kept), tuple(v for _, v in kept)))
    return out


@dataclasses.dataclass(frozen=True)
class Numerics:
    """One model in several forms.

    A truth that is integrated more finely than the model looks as if its control came half a time step late. So the
    model as it is competes with the model nearly continuous in time, before anything is named; and while sets are
    compared, a coarse form stands for either, with its error taken out (:meth:`Shooting.corrected`).

    Args:
        given: the model's own integrator and time step.
        fine: Runge-Kutta of fourth order; the same object where the model has it already.
        coarse: the model's own integrator, few steps.
        middle: Runge-Kutta with few steps, where coarse is not close enough; dry friction wants more of them.
        stiff: whether something touches in more than 1 % of the recorded poses, or constraints tie bodies together.
        finest: shorter steps, for sets with effects that are forces held within a step; None for the same as fine.
        firm: short steps, and the dry friction that its joints have sticks firmly; None where they have none.
        late: coarse by the leapfrog scheme, which costs as little and is often close where coarse is not; None on a
            stiff machine, and where it would be the same.
        quick: leapfrog in longer steps than finest, which then is one too; None where finest is Runge-Kutta's.
        firm_quick: the same for firm.
    """

    given: Engine
    fine: Engine
    coarse: Engine
    middle: Engine
    stiff: bool = False
    finest: Engine | None = None
    late: Engine | None = None
    firm: Engine | None = None
    quick: Engine | None = None
    firm_quick: Engine | None = None

    @classmethod
    def of(cls, machine: Machine, nthread: int = 0) -> Numerics:
        """Makes them for a machine."""
        model, channels = machine.model, machine.channels
        step = median_step(machine.fit)
        few = _steps(step, _STEP)
        plain, touching = substeps_for(model, machine.fit), _touching(machine)
        stiff = bool(model.neq or model.ntendon) or touching > _TOUCHING
        free = touching == 0.0
        stride = 1 if stiff else max(int(_STEP / step + 1e-6), 1)
        given = Engine(model, channels, plain, nthread)
        often = max(few, plain)
        seldom = _steps(step, _STIFF_STEP) if stiff else few
        same = model.opt.integrator == RUNGE_KUTTA and often == plain and not given.filters
        fine = given if same else Engine(model, channels, often, nthread, RUNGE_KUTTA)
        halfway = max(math.ceil(often / 2), few) if stiff else few
        coarse = Engine(model, channels, min(seldom, plain), nthread, _cheap(model), stride, contacts=not free)
        middle = fine
        if halfway < often:
            middle = Engine(model, channels, halfway, nthread, RUNGE_KUTTA, contacts=not free)

        late = None
        if not stiff and (model.nu or model.dof_damping.any()):
            late = Engine(model, channels, coarse.substeps, nthread, stride=stride, late=True, contacts=not free)
        leaps = not stiff and is_of_second_order(model)

        def leapfrog(form: mujoco.MjModel, steps: int, contacts: bool = True) -> Engine | None:
            return Engine(form, channels, steps, nthread, late=True, contacts=contacts) if leaps else None

        short, longer = _steps(step, _EFFECT_STEP if leaps else _HELD_STEP), _steps(step, _QUICK)
        finest, quick, firm, firm_quick = None, None, None, None
        if short > often:
            finest = leapfrog(model, short) or Engine(model, channels, short, nthread, RUNGE_KUTTA)
            quick = leapfrog(model, longer, contacts=not free)
        if model.dof_frictionloss.any():
            short = max(often, _steps(step, _FIRM_STEP if leaps else 2 * _FIRM_STEP))
            sticks = sticking(model, step / short)
            firm = leapfrog(sticks, short) or Engine(sticks, channels, short, nthread, RUNGE_KUTTA)
            firm_quick = leapfrog(sticking(model, step / longer), longer, contacts=not free)
        forms = (given, fine, coarse, middle, finest, late, firm, quick, firm_quick)
        begin_drives([engine for engine in forms if engine is not None], machine.fit)
        return cls(given, fine, coarse, middle, stiff, finest, late, firm, quick, firm_quick)

    def choose(
        self,
        segments: Segments,
        noise: NoiseModel,
        near: Fit,
        nominal: Fit,
        sets: Sets = (),
        known: Known | None = None,
    ) -> tuple[Engine, Shooting, Fit, Fit]:
        """Takes the form under which the first of some sets, or the nominal, fits better.

        Args:
            segments: S segments.
            noise: of the recordings.
            near: a fit to these segments to begin from.
            nominal: a fit of the nominal model to begin from.
            sets: effects and first guesses; the nominal model where there are none.
            known: an engine under which ``near`` is the fit of the first set already, and its likelihood.

        Returns:
            The precise engine; the likelihood to compare sets with; the nominal's fit; the first set's.
        """
        whole = Shooting(self.coarse, segments, noise)
        first, which = whole.subset(max(_JUDGES / segments.size, _PART))
        rough = here = near.pick(which)
        if sets and tuple(sets[0][0]) != near.effects:
            for cheap in dict.fromkeys((self.coarse, self.middle, self.given)):
                rough = dataclasses.replace(first, engine=cheap).fit(sets[:1], here.starts, design=here.design)[0]
                if np.isfinite(rough.chi2):
                    break
        trials = [*sets[:1], *_without_delays(sets[:1])]
        results, share = [], first.dof / whole.dof
        for engine in self._forms(trials[0][0] if trials else (), known):
            working, judged = self._working(engine, first, rough)
            others = working.fit(trials[1:], judged.starts, design=judged.design) if len(trials) > 1 else []
            best = min([judged, *others], key=lambda fit: fit.chi2 / share + _PRICE * fit.size)
            results.append((self._cost(engine, best, best.chi2 / share, whole.dof), engine, working, best))
        _, engine, working, judged = min(results, key=lambda result: result[0])
        if known is not None and engine is known[0] and judged.effects == near.effects:
            return *known, nominal, near
        if first.segments.size < segments.size:
            begin = dataclasses.replace(near, effects=judged.effects, values=judged.values)
            working, judged = _settled(
                dataclasses.replace(whole, engine=working.engine, cheap=self.coarse), engine, begin
            )
        if not sets:
            return engine, working, judged, judged
        return engine, working, working.fit([((), ())], nominal.starts, design=nominal.design)[0], judged

    def _cost(self, engine: Engine, fit: Fit, chi2: float, dof: int) -> float:
        """What a fit leaves, with what its parameters and its form must be worth."""
        price = _PRICE * fit.size + (_FINEST if engine in (self.finest, self.firm) else 0.0)
        much = max(chi2 - _MUCH * dof, 0.0)
        return chi2 + price + (0.0 if engine is self.given else _CLEARLY * much)

    def _forms(self, effects: Sequence[Effect], known: Known | None) -> list[Engine]:
        """The precise forms that compete behind a set; the one that was taken before is among them."""
        held = self.finest is not None and any(effect.needs_steps for effect in effects)
        forms = (self.given, self.fine, self.firm, *(known[:1] if known else ()), self.finest if held else None)
        return [form for form in dict.fromkeys(forms) if form is not None]

    def _working(self, engine: Engine, first: Shooting, rough: Fit) -> tuple[Shooting, Fit]:
        """The cheapest form that stays close to an engine, corrected by it.

        Where something touches, a correction holds for the instants of touching alone that it was made for; there a
        form must reach the fit that the engine itself reaches.
        """
        precise = dataclasses.replace(first, engine=engine, cheap=self.coarse)
        exact = _settled(precise, engine, rough)[1] if self.stiff else None
        if exact is not None and not np.isfinite(exact.chi2):
            return precise, exact
        working, judged = precise, rough
        quick = {self.finest: self.quick, self.firm: self.firm_quick}.get(engine)
        forms = (self.coarse, self.late or self.coarse, quick or self.middle, engine)
        for cheap in dict.fromkeys(forms):
            working, judged = _settled(dataclasses.replace(precise, engine=cheap), engine, judged)
            if not np.isfinite(judged.chi2):
                judged = rough
                continue
            if working.offset is None:
                break
            if exact is not None and judged.chi2 < exact.chi2 + _SAME * max(exact.chi2, float(working.dof)):
                break
            if exact is not None:
                judged = exact
            elif _unabsorbed(working, judged) < _CLOSE * max(1.0, _ROUGHLY * np.sqrt(judged.chi2 / working.dof)):
                break
        return working, judged


def _settled(working: Shooting, engine: Engine, judged: Fit) -> tuple[Shooting, Fit]:
    """A form corrected by an engine where its own fit ends, and that fit."""
    for _ in range(2):
        before = judged.chi2
        working = working.corrected(engine, judged)
        judged = working.fit([(judged.effects, judged.values)], judged.starts, design=judged.design)[0]
        if abs(judged.chi2 - before) < _SETTLED * judged.chi2:
            break
    return working, chained(working, judged) if np.isfinite(judged.chi2) else judged


def _unabsorbed(shooting: Shooting, fit: Fit) -> float:
    """The largest part of the offset that no change of the initial states makes, in units of the noise."""
    assert shooting.offset is not None
    assert fit.design is not None
    offset = np.nan_to_num(shooting.noise.whiten(shooting.segments, shooting.offset))
    basis, _ = np.linalg.qr(fit.design)
    return float(np.abs(offset - np.einsum("smn,sn->sm", basis, np.einsum("smn,sm->sn", basis, offset))).max())
