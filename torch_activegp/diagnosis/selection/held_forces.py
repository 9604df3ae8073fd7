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
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect, Index, Step
from torch_activegp.physics.friction import AsymmetricCoulomb, CoulombFriction, StribeckFriction
from torch_activegp.physics.joint import JointEffect

_STAND_FOR_STEPS = frozenset({"armature_error", "payload_mass", "viscous_friction"})
_DRY = (CoulombFriction, StribeckFriction, AsymmetricCoulomb)
_SLACK = 1.5
"""Times what a whole time step makes that may be meant."""
_BESIDE = 1e-3
"""Part of a motion by which it is changed to see how a force changes."""


@dataclasses.dataclass(frozen=True, eq=False)
class HeldForce(JointEffect):
    """The law of another effect, of the state that a time step begins with, held over the step.

    Args:
        of: the effect.
    """

    of: JointEffect | None = None

    name = "held_force"
    law = "that of another effect, as it is when a time step begins"

    @classmethod
    def like(cls, effect: JointEffect) -> HeldForce:
        """An effect so."""
        same = {f.name: getattr(effect, f.name) for f in dataclasses.fields(JointEffect)}
        return cls(**same, of=effect)

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Adds the force at the start of each time step."""
        assert self.of is not None
        position, velocity = step.qpos[rows, self.qpos], step.qvel[rows, self.dof]
        step.force[rows, self.dof] += self.of.force(position, velocity, values.T)


def of_held_forces(numerics: Numerics, engine: Engine, shooting: Shooting, selection: Selection) -> frozenset[Effect]:
    """What the best set does without where forces are held over each time step: inertias, dampings, and what follows.

    MuJoCo takes damping at the speed with which a step of length h ends, and Runge-Kutta follows every force within
    one. A simulator whose author adds a force -c v before each step takes it at the speed with which that begins: then
    the machine seems to have h c less inertia, or half of that, and by Runge-Kutta h k/2 less damping for a force -k q.
    A ball screw of 25 kg that had 60 N s/m more one way, in steps of 0.5 ms, was 15.5 g too heavy beside the right
    friction, for at 3 um of noise that shows. And the drag of a pendulum, held over 2.5 ms, had 0.3 % less inertia and
    a cogging of 34.7 periods beside it.

    Args:
        numerics: the forms of the model.
        engine: the form under which sets were compared.
        shooting: the likelihood.
        selection: the compared sets.
    """
    best = selection.best
    steps = dict.fromkeys((numerics.given, engine))
    longest = median_step(shooting.segments.runs) / min(form.substeps for form in steps)
    meant = frozenset(effect for effect in best.effects if _may_be_a_step(shooting, best, effect, longest))
    if not meant:
        return meant
    for form in steps:
        other = dataclasses.replace(shooting, engine=form, offset=None)
        if (kept := _that_pay(other, selection, meant)) is not None:
            return frozenset(best.effects) - kept
    return frozenset()


def _that_pay(shooting: Shooting, selection: Selection, meant: frozenset[Effect]) -> frozenset[Effect] | None:
    """Those of the best set's effects, but for some, that are needed where forces are held; None where that is worse.

    Args:
        shooting: the likelihood by a form whose steps they are held over.
        selection: the compared sets.
        meant: effects that may be a step.
    """
    best, score = selection.best, selection.score
    kept = {effect: _held(effect) or effect for effect in best.effects if effect not in meant}
    fit = shooting.fit([(tuple(kept.values()), tuple(best.by_effect[e] for e in kept))], best.starts)[0]
    if not score(fit) <= score(best):
        return None
    while len(kept) > 1:
        rests = [[held for held in kept.values() if held is not one] for one in kept.values()]
        fits = shooting.fit([fit.part(rest) for rest in rests], fit.starts, near=fit)
        scores = [score(other) for other in fits]
        least = int(np.argmin(scores))
        if not scores[least] <= score(fit):
            break
        del kept[list(kept)[least]]
        fit = fits[least]
    return frozenset(kept)


def _held(effect: Effect) -> HeldForce | None:
    """An effect so, where it is a force of position and speed alone that neither strikes nor sticks; else None."""
    if not isinstance(effect, JointEffect) or effect.strikes or isinstance(effect, _DRY):
        return None
    own = type(effect)
    remembers, lawless = own.memory is not Effect.memory, own.force is JointEffect.force
    return None if remembers or lawless else HeldForce.like(effect)


def _may_be_a_step(shooting: Shooting, fit: Fit, effect: Effect, step: float) -> bool:
    """Whether an inertia or a damping is as small as steps of a length, s, make it behind the other names of a set."""
    if effect.name not in _STAND_FOR_STEPS:
        return False
    model, most = shooting.engine.model, np.zeros((2, shooting.engine.model.nv))
    edited = with_effects(model, [effect], [fit.by_effect[effect]])
    changed = np.abs([of(edited) - of(model) for of in (_inertia, _damping)])
    for other, values in fit.by_effect.items():
        if other is not effect and (held := _held(other)) is not None:
            most[:, held.dof] += _slopes(shooting, held, values)
    return bool((changed <= _SLACK * step * most).all())


def _slopes(shooting: Shooting, held: HeldForce, values: Array) -> Array:
    """How a force changes with speed and with position, in the root mean square over the recordings, ``(2,)``."""
    of, channels, runs = held.of, shooting.engine.channels, shooting.segments.runs
    assert of is not None
    at = np.flatnonzero(channels.dof == held.dof)
    if not at.size:
        return np.zeros(2)
    moved = ([getattr(run, rows)[:, at[0]] for run in runs] for rows in ("smooth", "velocity"))
    position, velocity = map(np.concatenate, moved)
    little = _BESIDE * position.std(), _BESIDE * velocity.std()
    ahead = of.force(position, velocity + little[1], values), of.force(position + little[0], velocity, values)
    behind = of.force(position, velocity - little[1], values), of.force(position - little[0], velocity, values)
    return np.array(
        [
            np.sqrt(np.mean((one - other) ** 2)) / max(2.0 * size, 1e-300)
            for one, other, size in zip(ahead, behind, reversed(little), strict=True)
        ]
    )


def _inertia(model: mujoco.MjModel) -> Array:
    """The inertia of each degree of freedom at the model's pose, ``(nv,)``, kg or kg m2."""
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return np.diag(full)


def _damping(model: mujoco.MjModel) -> Array:
    return np.array(model.dof_damping)
