"""The forms of a model: its own integrator and time step, finer ones, and cheap ones that stand in for them."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Self

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Run, median_step
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.simulation.calm import CalmEngine, SmoothEngine
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import IMPLICIT_FAST, Engine, substeps_for
from torch_activegp.diagnosis.simulation.explicit_damping import explicit
from torch_activegp.diagnosis.simulation.leapfrog import is_of_second_order, servo_damping
from torch_activegp.diagnosis.simulation.prescribed_motion import RUNGE_KUTTA
from torch_activegp.diagnosis.simulation.touching import TOUCHING, is_tied, poses_that_touch
from torch_activegp.physics.friction import sticking

_LONGEST = 0.005
"""Time steps of cheap forms, s."""
_PIECE, _ABOUT = 0.25, 0.1
"""How long pieces are in which these are compared with the model, s, and by what part of the motion they may be off."""
_STIFF_STEP = 0.001
_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_EFFECT_STEP, _HELD_STEP = 0.0005, 0.00125
"""An effect that is a force is held in each time step: a stop or a play that acts for milliseconds wants short ones,
and friction sticks as firmly as two of them allow. Leapfrog in the first is more exact than Runge-Kutta in the second
where it is of second order: 1.1 per dof for 2.4 where a joint sticks and slips at 0.3 mrad."""
_FIRM_STEP = 0.00025
"""For friction of the model's own: a joint that sticks and slips at 0.05 mrad noise left 2.3 per dof with Runge-Kutta
in steps of 0.5 ms, and 0.89, as the noise alone, with leapfrog in half of that. Two coupled ones left 8.3 and 1.3."""
_QUICK = 0.00125
FEW_SHORTER = (2, 4, 5, 10, 20)
_SHORTER, _SHORTEST, _STIFF_SHORTEST = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20), 0.95e-4, 1.9e-4
"""How many times shorter the machine's steps may be, a few of these where each of them must be tried, as of a simulator
that is recorded in the model's place; and not below, s. Integrators of first order put a control half a step early:
0.25 ms left 1.7 times the noise of 0.5 mrad on an arm of two joints, where Runge-Kutta was the only other form, and no
name explained it. Stiff servos that were simulated in 0.42 ms left 1.1 behind 0.5 ms, and damping was named."""
_QUARTER = 4
"""Times as many steps as the model's own, at most, in forms that do not compete where something touches. Constraints
that tie bodies together are as soft as a time step is long, and there are more of these: a five-bar that was simulated
in 0.1 ms left 1.046 of the noise in steps of 1 ms by Runge-Kutta, 1.047 in 0.2 ms of its own, 1.032 in 0.1 ms, and two
dampings that were none as much."""
_QUICKER = 4
"""Times as many steps as the model's own in what stands in for its own integrator in even more."""
_HEAD = 0.5
"""How much of each run shows with what its drives began, s."""

_COMPARED, _AGREES = 12, 0.1
"""Segments on which a form with long steps is compared with the one without, and by what part of the noise it may
differ."""
_SMOOTH_STEPS, _SAME = (0.01, 0.005), 0.01
"""Steps of Runge-Kutta that may be enough where nothing touches or sticks, s, and by what part of the noise they may be
off. In steps of 1 ms as the model's own it took a third of the time of a double pendulum's diagnosis."""
_SELDOM = 0.3
"""What touches in fewer poses strikes now and then: more time steps are wanted there alone."""

Make = Callable[..., Engine]


@dataclasses.dataclass(frozen=True)
class Forms:
    """One model in several forms.

    Args:
        given: the model's own integrator and time step.
        fine: Runge-Kutta of fourth order; the same object where the model has it already.
        coarse: the model's own integrator, few steps; where something touches and another form was clearly closer in
            brief pieces, that one.
        middle: Runge-Kutta with few steps, where coarse is not close enough; dry friction wants more of them.
        stiff: whether something touches in more than 1 % of the recorded poses, or constraints tie bodies together.
        late: coarse by the leapfrog scheme, which costs as little and is often close where coarse is not; None on a
            stiff machine, and where it would be the same.
        finest: shorter steps, for sets with effects that are forces held within a step; None for the same as fine.
        leapt: the same by leapfrog where that is of first order in some forces, so that finest is Runge-Kutta's: either
            may be closer.
        quick: leapfrog in longer steps than finest or leapt; None where neither is one.
        firm: short steps, and the dry friction that its joints have sticks firmly; None where they have none.
        firm_leapt: to it as leapt is to finest.
        firm_quick: to it as quick is to finest.
        own: the model's own integrator in shorter steps; semi-implicit Euler in place of Runge-Kutta, but where
            something touches: that is soft by as much as a time step is long, in Runge-Kutta's too. Nor where drives
            are of the type ``filterexact``: their forces are late by half a step, in Runge-Kutta's too. And, for
            simulators that are not MuJoCo's, semi-implicit Euler with damping at the speed that a step begins with.
        finer: the model's own integrator in half and quarter steps where something touches, and shorter ones where
            constraints tie bodies together; they do not compete.
    """

    given: Engine
    fine: Engine
    coarse: Engine
    middle: Engine
    stiff: bool = False
    late: Engine | None = None
    finest: Engine | None = None
    leapt: Engine | None = None
    quick: Engine | None = None
    firm: Engine | None = None
    firm_leapt: Engine | None = None
    firm_quick: Engine | None = None
    own: tuple[Engine, ...] = ()
    finer: tuple[Engine, ...] = ()

    @classmethod
    def of(cls, machine: Machine, nthread: int = 0) -> Self:
        """Makes them for a machine."""
        model, step = machine.model, median_step(machine.fit)
        make: Make = functools.partial(Engine, channels=machine.channels, nthread=nthread)
        plain, tied = substeps_for(model, machine.fit), is_tied(model)
        part = float(poses_that_touch(model, machine.channels, (*machine.fit, *machine.holdout))[1].mean())
        stiff, free = tied or part > TOUCHING, part == 0.0
        given = make(model, substeps=plain)
        longest = _LONGEST if stiff else _bearable(model, make, machine.fit)
        few, stride = _steps(step, longest), 1 if stiff else max(int(longest / step + 1e-6), 1)
        often = max(few, plain)
        seldom = _steps(step, _STIFF_STEP) if stiff else few
        striking: Make = make  # what strikes something now and then takes long steps where nothing touches
        if stiff and not tied and part < _SELDOM:
            striking = functools.partial(CalmEngine, channels=machine.channels, calm=few, nthread=nthread)
        same = model.opt.integrator == RUNGE_KUTTA and often == plain and not given.filters
        fine = given if same else make(model, substeps=often, integrator=RUNGE_KUTTA)
        moved = given.filters or model.na or machine.channels.prescribed is not None  # within a step
        if free and not (tied or moved or model.dof_frictionloss.any()):
            fine = _in_long_steps(fine, model, machine, nthread)
            given = fine if same else given
        if striking is not make and not same:
            calm = striking(model, substeps=often, integrator=RUNGE_KUTTA)
            fine = calm if _agrees(calm, fine, machine.fit) else fine
        halfway = max(math.ceil(often / 2), few) if stiff else few
        contacts = {"contacts": not free} if striking is make else {}
        middle, cheap = fine, contacts and contacts | {"stride": stride}
        if halfway < often:
            middle = striking(model, substeps=halfway, integrator=RUNGE_KUTTA, **contacts)
        coarse = striking(model, substeps=min(seldom, plain), integrator=_cheap(model), **cheap)
        late, second = None, not stiff and is_of_second_order(model)
        where = make, model, step, often
        short = _held(*where, leaps=not stiff, second=second, free=free)
        short |= _firm(*where, leaps=not stiff, second=second, free=free)
        if not stiff and (model.nu or model.dof_damping.any()):
            late = make(model, substeps=coarse.substeps, late=True, **cheap)
        times, least = (FEW_SHORTER, _STIFF_SHORTEST) if stiff else (_SHORTER, _SHORTEST)
        shorter = [plain * many for many in times if step / (plain * many) > least]
        late_drives = bool((model.actuator_dyntype == int(mujoco.mjtDyn.mjDYN_FILTEREXACT)).any())
        euler = model.opt.integrator == RUNGE_KUTTA and not (stiff or late_drives)
        first = IMPLICIT_FAST if euler else None
        own = [make(model, substeps=steps, integrator=first) for steps in shorter]
        if model.dof_frictionloss.any():
            some = [steps for steps in shorter if steps // plain in FEW_SHORTER]
            own += [make(sticking(model, step / steps), substeps=steps, integrator=first) for steps in some]
        if not late_drives and (model.dof_damping.any() or servo_damping(model).any()):
            own += [make(explicit(model), substeps=steps, integrator=_EULER) for steps in shorter]
        finest = (many for many in FEW_SHORTER if many <= _QUARTER or (tied and step / (plain * many) > _SHORTEST))
        finer = tuple(make(model, substeps=plain * many) for many in finest) if stiff else ()
        made = cls(given, fine, coarse, middle, stiff, late, **short, own=tuple(own), finer=finer)
        begin_drives(made.all, machine.fit)
        return made

    @property
    def all(self) -> list[Engine]:
        """Every form there is, the given one first."""
        forms = [form for form in vars(self).values() if isinstance(form, Engine)]
        return list(dict.fromkeys((self.given, *forms, *self.own, *self.finer)))

    @property
    def short(self) -> tuple[Engine, ...]:
        """Those in short steps, which cost time."""
        return tuple(form for form in (self.finest, self.leapt, self.firm, self.firm_leapt) if form is not None)

    def stand_in(self, engine: Engine) -> Engine:
        """What may stand in for one of the forms where no coarse one is close."""
        if engine in self.own:
            quicker = range(_QUICKER * self.given.substeps, engine.substeps // 2 + 1)
            same = self.sticks(engine), engine.scheme
            alike = (own for own in self.own if (self.sticks(own), own.scheme) == same)
            return next((own for own in alike if own.substeps in quicker), engine)
        quick = self.firm_quick if self.sticks(engine) else self.quick
        return quick if quick is not None and engine in self.short and engine.late else self.middle

    def sticks(self, engine: Engine) -> bool:
        """Whether the joints' own dry friction sticks firmly in one of the forms."""
        return not np.array_equal(engine.model.dof_solref, self.given.model.dof_solref)


def _bearable(model: mujoco.MjModel, make: Make, runs: Sequence[Run]) -> float:
    """The longest time step, s, in which cheap forms do about what the model does in a fourth of a second.

    In longer ones what is stiff flies apart: a loudspeaker's cone, which swings at 70 Hz, did at 5 ms. What is struck
    by accident is not counted.
    """
    step, own = median_step(runs), float(model.opt.timestep)
    pieces = cut(runs, _PIECE, 0.0)
    pieces = pieces.pick(pieces.spread(_COMPARED))
    given = make(model, substeps=substeps_for(model, runs), contacts=False)
    starts, moves = given.starts(pieces)[None], np.std(pieces.position[pieces.counts], axis=0)
    told = given.predict(pieces, starts, [NOMINAL])[0]
    sound = np.isfinite(told).all(axis=(1, 2))
    longest = _LONGEST
    while longest > own and sound.any():
        steps, stride = min(_steps(step, longest), given.substeps), max(int(longest / step + 1e-6), 1)
        cheap = make(model, substeps=steps, integrator=_cheap(model), stride=stride, contacts=False)
        apart = (cheap.predict(pieces, starts, [NOMINAL])[0] - told)[sound]
        if (np.sqrt(np.mean(apart**2, axis=(0, 1))) <= _ABOUT * moves).all():  # false where it flies apart
            break
        longest = max(0.5 * longest, own)
    return longest


def _in_long_steps(plain: Engine, model: mujoco.MjModel, machine: Machine, nthread: int) -> Engine:
    """An engine by Runge-Kutta in the longest steps that do the same, for effects that are smooth; or itself."""
    step, integrator = median_step(machine.fit), int(plain.model.opt.integrator)
    make = functools.partial(Engine, model, machine.channels, nthread=nthread, integrator=integrator)
    same = _SAME * np.mean([run.noise for run in machine.fit], axis=0)
    for calm in (_steps(step, longest) for longest in _SMOOTH_STEPS):
        if calm < plain.substeps and _agrees(make(substeps=calm), plain, machine.fit, _SAME):
            return SmoothEngine(model, machine.channels, plain.substeps, calm, same, nthread, integrator)
    return plain


def _held(
    make: Make, model: mujoco.MjModel, step: float, often: int, leaps: bool, second: bool, free: bool
) -> dict[str, Engine | None]:
    """Forms for effects that are held within a step: ``finest``, ``leapt`` and ``quick``."""
    leap, held = _steps(step, _EFFECT_STEP), _steps(step, _HELD_STEP)
    leapt = make(model, substeps=leap, late=True) if leap > often and leaps else None
    quick = make(model, substeps=_steps(step, _QUICK), late=True, contacts=not free) if leapt else None
    if leapt is not None and second:
        return {"finest": leapt, "quick": quick}
    finest = make(model, substeps=held, integrator=RUNGE_KUTTA) if held > often else None
    return {"finest": finest, "leapt": leapt, "quick": quick}


def _firm(
    make: Make, model: mujoco.MjModel, step: float, often: int, leaps: bool, second: bool, free: bool
) -> dict[str, Engine | None]:
    """The same with the dry friction that joints have sticking firmly: ``firm``, ``firm_leapt`` and ``firm_quick``."""
    if not model.dof_frictionloss.any():
        return {}

    def by(steps: int, **how: bool | int) -> Engine:
        return make(sticking(model, step / steps), substeps=steps, **how)

    leapt = by(max(often, _steps(step, _FIRM_STEP)), late=True) if leaps else None
    quick = by(_steps(step, _QUICK), late=True, contacts=not free) if leaps else None
    if second:
        return {"firm": leapt, "firm_quick": quick}
    firm = by(max(often, _steps(step, 2 * _FIRM_STEP)), integrator=RUNGE_KUTTA)
    return {"firm": firm, "firm_leapt": leapt, "firm_quick": quick}


def _agrees(calm: Engine, plain: Engine, runs: Sequence[Run], least: float = _AGREES) -> bool:
    """Whether an engine that takes few steps now and then does what another one does, to a part of the noise."""
    segments = cut(runs, 1.0, 0.0)
    segments = segments.pick(segments.spread(_COMPARED))
    starts = plain.starts(segments)[None]
    one, other = (engine.predict(segments, starts, [NOMINAL]) for engine in (calm, plain))
    noise = np.mean([run.noise for run in runs], axis=0)
    return bool(np.isfinite(one).all() and (np.abs(one - other) < least * noise).all())


def _steps(interval: float, longest: float) -> int:
    """Time steps in an interval, of some length at most."""
    return max(int(np.ceil(interval / longest - 1e-6)), 1)


def _cheap(model: mujoco.MjModel) -> int:
    """The model's integrator, or the implicit one in place of Runge-Kutta's four evaluations."""
    runge_kutta = model.opt.integrator == RUNGE_KUTTA
    return IMPLICIT_FAST if runge_kutta else int(model.opt.integrator)


def begin_drives(engines: Sequence[Engine], runs: Sequence[Run]) -> None:
    """Lets filters of the model's own drives begin each run empty or filled: as the first engine follows it better."""
    first = engines[0]
    if not first.filters:
        return
    pieces = cut(runs, _HEAD, 0.0)
    heads = pieces.pick(np.flatnonzero(pieces.first == 0))
    errors = []
    for empty in (False, True):
        first.filters = tuple(own._replace(empty=empty) for own in first.filters)
        predicted = first.predict(heads, first.starts(heads)[None], [NOMINAL])
        far = (predicted[0] - heads.position) / np.mean([run.noise for run in runs], axis=0)
        errors.append(float(np.nan_to_num(far[heads.counts] ** 2, nan=np.inf).sum()))
    for engine in engines:
        engine.filters = tuple(own._replace(empty=errors[1] < errors[0]) for own in engine.filters)
