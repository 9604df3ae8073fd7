"""Names that stand for when in a time step the force of another one is taken."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array, median_step
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.inertial_forces import with_effects
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.held_force import HeldForce

_CANDIDATES = frozenset({"armature_error", "payload_mass", "viscous_friction"})
_MOST = 1.5
"""Times what a whole time step makes that may be one."""
_LOUD = 2.0
"""Times the noise from which on more is missing than a step makes."""
_WORK = 4e6
"""Time steps that the fits may take."""


def of_held_forces(numerics: Numerics, engine: Engine, shooting: Shooting, selection: Selection) -> frozenset[Effect]:
    """What the best set does without where forces are held over each time step: inertias, dampings, and what follows.

    MuJoCo takes damping at the speed with which a step of length h ends, and Runge-Kutta follows every force within
    one. A simulator whose author adds a force -c v before each step takes it at the speed with which that begins: the
    machine seems to have h c less inertia, or half of that, and by Runge-Kutta h k/2 less damping for a force -k q.

    :func:`~torch_activegp.diagnosis.preparation.late.without_half_steps` is of the model's own damping and servos,
    which other forms of the model take otherwise; no form holds the force of a name.

    Args:
        numerics: the forms of the model.
        engine: the form under which sets were compared.
        shooting: the likelihood.
        selection: the compared sets.

    Returns:
        Effects of the best set; none of a black box, and where much is left or the search was cut short.
    """
    best = selection.best
    if isinstance(engine, BlackBoxEngine) or selection.cut_short or best.chi2 > _LOUD * shooting.dof:
        return frozenset()
    forms = dict.fromkeys((numerics.given, engine))
    longest = median_step(shooting.segments.runs) / min(form.substeps for form in forms)
    candidates = frozenset(effect for effect in best.effects if _may_be_a_step(shooting, best, effect, longest))
    if not candidates:
        return candidates
    for form in forms:
        other = dataclasses.replace(shooting, engine=form, offset=None)
        if (kept := _that_pay(other, selection, candidates)) is not None:
            return frozenset(best.effects) - kept
    return frozenset()


def _that_pay(shooting: Shooting, selection: Selection, candidates: frozenset[Effect]) -> frozenset[Effect] | None:
    """Those of the best set's effects, but for some, that are needed where forces are held; None where that is worse.

    Args:
        shooting: the likelihood by a form whose steps they are held over.
        selection: the compared sets.
        candidates: effects that may be a step.
    """
    best, most = selection.best, shooting.work + _WORK

    def score(fit: Fit, effects: list[Effect]) -> float:
        """That of the laws that are held, which are no others."""
        return selection.score(dataclasses.replace(fit, effects=tuple(effects)))

    kept = [effect for effect in best.effects if effect not in candidates]
    held = {effect: HeldForce.like(effect) or effect for effect in kept}
    fit = shooting.fit([(tuple(held.values()), best.part(kept)[1])], best.starts, work=most)[0]
    if not score(fit, kept) <= selection.score(best):
        return None
    while len(kept) > 1:
        rests = [[effect for effect in kept if effect is not one] for one in kept]
        fits = shooting.fit([fit.part(held[e] for e in rest) for rest in rests], fit.starts, near=fit, work=most)
        scores = [score(other, rest) for other, rest in zip(fits, rests, strict=True)]
        least = int(np.argmin(scores))
        if not scores[least] <= score(fit, kept):
            break
        fit, kept = fits[least], rests[least]
    return frozenset(kept)


def _may_be_a_step(shooting: Shooting, fit: Fit, effect: Effect, step: float) -> bool:
    """Whether an inertia or a damping is as small as steps of a length, s, make it behind the other names of a set.

    Inertias are those at the model's own pose.
    """
    if effect.name not in _CANDIDATES:
        return False
    model, most = shooting.engine.model, np.zeros((2, shooting.engine.model.nv))
    edited = with_effects(model, [effect], [fit.by_effect[effect]])
    changed = np.abs([_inertia(edited) - _inertia(model), edited.dof_damping - model.dof_damping])
    for other, values in fit.by_effect.items():
        if (held := HeldForce.like(other)) is not None:
            most[:, held.dof] += _slopes(shooting, held, values)
    return bool((changed <= _MOST * step * most).all())


def _slopes(shooting: Shooting, held: HeldForce, values: Array) -> Array:
    """Those of a force along the recordings, ``(2,)``; none on a joint that is not recorded."""
    at, runs = np.flatnonzero(shooting.engine.channels.dof == held.dof), shooting.segments.runs
    if not at.size:
        return np.zeros(2)
    position = np.concatenate([run.smooth[:, at[0]] for run in runs])
    velocity = np.concatenate([run.velocity[:, at[0]] for run in runs])
    return held.slopes(position, velocity, values)


def _inertia(model: mujoco.MjModel) -> Array:
    """The inertia of each degree of freedom at the model's pose, ``(nv,)``, kg or kg m2."""
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return np.diag(full)
