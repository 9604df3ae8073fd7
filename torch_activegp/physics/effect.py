"""What an effect is: physics that a simulator may have left out, as a law with parameters on a part of the machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.physics.place import Place

Array = NDArray[np.float64]
Index = NDArray[np.integer[Any]]

_OF_THE_SIZE = 0.05
"""Friction that holds and lets go is not smooth: a smaller step sees single slips."""
_OF_THE_SCALE = 0.2


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One number of a law.

    Args:
        name: the field's word for it.
        unit: SI unit.
        scale: a value that is small but matters on this machine; finite differences and screening use it.
        low: least value that physics allows.
        high: largest value.
        place: whether it says where on an axis something is (a stop, a number of periods), so that its own size is no
            measure of what a small change is.
    """

    name: str
    unit: str
    scale: float
    low: float = -np.inf
    high: float = np.inf
    place: bool = False

    def step(self, value: float) -> float:
        """A small change for a finite difference at some value, within the bounds."""
        size = _OF_THE_SCALE * self.scale if self.place else _OF_THE_SIZE * max(abs(value), self.scale)
        return -size if value + size > self.high else size


@dataclasses.dataclass
class Step:
    """What an effect sees and may change before each time step of R simulations side by side.

    Args:
        qpos: positions, ``(R, nq)``.
        qvel: velocities, ``(R, nv)``, rad/s or m/s.
        ctrl: controls of this step, ``(R, nu)``.
        force: generalised forces to add to, ``(R, nv)``, N m or N.
        field: gives a field of ``MjModel`` by name with one value for each simulation, ``(R, ...)``, to write.
        dt: length of the step, ``(R,)``, s.
        middle: the part of the step after which a force that is held over it acts as one that changes would: half of it
            for Runge-Kutta, 0 for the semi-implicit Euler scheme, whose forces act on the speed before it moves.
    """

    qpos: Array
    qvel: Array
    ctrl: Array
    force: Array
    field: Callable[[str], Array]
    dt: Array
    middle: float = 0.0

    def position(self, rows: Index, address: int, dof: int) -> Array:
        """Of a joint where forces of some simulations should be taken, ``(n,)``, rad or m."""
        ahead = self.middle * self.dt[rows] * self.qvel[rows, dof] if self.middle else 0.0
        return np.asarray(self.qpos[rows, address] + ahead)


class Acting(NamedTuple):
    """Where alone an effect shows.

    Args:
        joint: which joint it moves.
        over: canonical name of the variable, for example ``qvel.elbow``.
        within: intervals of it, from and to.
    """

    joint: str
    over: str
    within: tuple[tuple[float, float], ...]


@dataclasses.dataclass(frozen=True, eq=False)
class Effect:
    """A law on one target. Subclasses say how it acts by overriding one of the hooks, each of which does nothing here.

    Values come as ``(rows, P)``, one row a simulation; ``rows`` are the simulations that the effect acts in.

    Args:
        target: ``joint:``, ``actuator:``, ``body:`` or ``sensor:`` and the model's own name, or ``world``.
        parameters: the P parameters. The first ``linear`` of them are amplitudes: at 0 the effect is absent.
        seeds: values to start from, ``(n, P)``; the amplitudes in them serve where ``linear`` is 0.
        linear: number of parameters in which the effect is linear. Where there is none and one parameter that is no
            `place`, that is a size: from 0 on the effect grows with it.
        variant: tells apart several forms of one name on one target.
        stands_in: whether this form is tried only in place of another one that a set holds already.
        more: this law and the same once more with other values, as one effect; None where a law acts but once.
        tunable: whether a modeller would have tuned it on the machine's data, so that a nominal can hide others in it.
    """

    target: str
    parameters: tuple[Parameter, ...]
    seeds: Array
    linear: int = 1
    variant: str = ""
    stands_in: bool = False
    more: Effect | None = None
    tunable: bool = False

    name: ClassVar[str]
    law: ClassVar[str]
    covers: ClassVar[tuple[str, ...]] = ()
    """Names of effects on the same target that this one contains."""
    never_negative: ClassVar[frozenset[str]] = frozenset()
    """Described parameters of which no machine has less than none; their intervals say so."""
    vector: ClassVar[bool] = False
    """Whether its parameters are components of one vector, so that more than one of them say no more than one does."""
    order: ClassVar[int] = 0
    """Place in which it is written into a model: on a drive, in the chain from its command to its force."""
    needs_past: ClassVar[bool] = False
    """Whether :meth:`memory` takes, as its fourth, the :class:`~torch_activegp.physics.rotor.Past`."""
    strikes: ClassVar[bool] = False
    """Whether it acts suddenly, at an instant that a time step has room for: its numbers want short ones."""
    losses: ClassVar[frozenset[str]] = frozenset()
    """Described amplitudes of what a machine has or has not: where all are negative, the simulator has too much."""

    def law_with(self, values: Array) -> str:
        """The law in words, with what its described parameters do not say, for parameters ``(P,)``."""
        return self.law

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether a place can have it, and the recordings would show it as something of its own there."""
        return True

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a place; every class that can be tried there says how.

        Args:
            place: a joint, an actuator or a recorded position, and what the recordings show there.
            model: compiled nominal model.

        Returns:
            The effect, its parameters and seeds sized for the place.
        """
        raise NotImplementedError

    @property
    def needs_steps(self) -> bool:
        """Whether :meth:`before_step` does something."""
        return False

    @property
    def item(self) -> str:
        """The model's own name of the target."""
        return self.target.partition(":")[2]

    @property
    def acts_on(self) -> str:
        """The joint that it acts on, that of its drive or encoder too; its own target where there is no one joint."""
        return self.target

    @property
    def key(self) -> tuple[str, str]:
        """Name and target."""
        return self.name, self.target

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Changes the model of some simulations; returns whether derived constants must be computed anew."""
        return False

    def steady(self, force: Array, rows: Index, values: Array) -> None:
        """Adds generalised forces that never change, ``(R, nv)``, N m or N, before the first time step."""

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Adds forces, or changes the model, before each time step."""

    def show(self, qpos: Array, qvel: Array, rows: Index, values: Array, memory: Array | None) -> None:
        """Changes what encoders see of positions ``(R, nq)`` and velocities ``(R, nv)`` at a row, in place.

        Asked where :attr:`needs_steps`, of MuJoCo models alone.
        """

    def memory(self, positions: Array, starts: Array, values: Array) -> Array | None:
        """State of the effect at the start of each simulation; see :mod:`torch_activegp.physics.play`."""
        return None

    def anew(self) -> Self:
        """What it is for one step from a state alone, where nothing tells how the machine came there."""
        return self

    def control(self, control: Array, dt: Array, values: Array) -> Array | None:
        """Maps the controls of whole runs ``(n, runs, T, nu)`` in place; dt is ``(runs, T)``, s; values ``(n, P)``."""
        return None

    def measure(self, read: Callable[[int, Array], Array], values: Array) -> tuple[int, Array] | None:
        """Changes a recorded channel; see :mod:`torch_activegp.physics.sensing`."""
        return None

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes the effect with values ``(P,)`` into a model; returns whether MJCF can hold it."""
        return False

    def plausible(self, values: Array) -> bool:
        """Whether a machine can have the effect with these values; bounds of single parameters are checked before."""
        return True

    def acts(self, values: Array) -> Acting | None:
        """Where alone the effect shows, for one that does so only somewhere; None for one that acts everywhere."""
        return None

    def starts_beside(self, values: Array) -> list[Array]:
        """Further values ``(P,)`` worth starting a fit from, where first-order values ``(P,)`` may lead nowhere."""
        return []

    def further_in(self, values: Array) -> list[Array]:
        """Values ``(P,)`` for what is struck earlier on the way than with these, ``(P,)``; none where nothing is."""
        return []

    def as_hard(self, values: Array) -> list[Array]:
        """Values ``(P,)`` for what is struck as far on the way, softer and harder; none where nothing is."""
        return []

    def taking_over(self, other: Effect, values: Array) -> Array:
        """Values ``(P,)`` with which this form of a name begins in place of another form with some values.

        What has the same name stays; further amplitudes begin at 0, shapes at the first seed.
        """
        known = dict(zip((parameter.name for parameter in other.parameters), values, strict=True))
        begin = np.where(np.arange(len(self.parameters)) < self.linear, 0.0, self.seeds[0])
        return np.array([known.get(p.name, v) for p, v in zip(self.parameters, begin, strict=True)], dtype=float)

    def absent(self, values: Array) -> Array:
        """Values ``(P,)`` with which it does nothing: no amplitude, the same shape."""
        return np.where(np.arange(len(values)) < (self.linear or len(values)), 0.0, values)

    def once_more(self, values: Array, added: Array) -> tuple[Effect, Array] | None:
        """This law with some values ``(P,)``, once more with others: :attr:`more` and its values; None without it."""
        return None

    def once_less(self, values: Array) -> list[Array]:
        """Values of the form that acts once less, without each time in turn; none of a law that acts but once."""
        return []

    def scan(self, position: Array, pull: Array) -> Array:
        """Seeds ``(n, P)`` beside :attr:`seeds` for shapes that one recording shows and no list foresees.

        Args:
            position: where the joint was, rad or m, ``(N,)``.
            pull: gradient of the likelihood by a force there and then, ``(N,)``.
        """
        return np.zeros((0, len(self.parameters)))

    def family(self) -> list[Effect]:
        """This effect, and those that it becomes when its law acts more than once."""
        return [self, *(self.more.family() if self.more is not None else [])]

    def describe(self, values: Array) -> dict[str, float]:
        """The parameters by name."""
        return {parameter.name: float(value) for parameter, value in zip(self.parameters, values, strict=True)}

    def too_much(self, values: Array) -> bool:
        """Whether values ``(P,)`` say that the simulator has too much of this, rather than too little."""
        amplitudes = [value for name, value in self.describe(values).items() if name in self.losses]
        return bool(amplitudes) and max(amplitudes) < 0.0


def field_of(model: mujoco.MjModel, name: str) -> Any:
    """A field of a model by the name that :meth:`Effect.edit` has for it, such as ``body_mass`` or ``opt.gravity``."""
    return getattr(model.opt, name[4:]) if name.startswith("opt.") else getattr(model, name)


def element(spec: mujoco.MjSpec, items: Sequence[Any], target: str) -> Any:
    """The element of a model that is being edited which a target such as ``joint:elbow`` names.

    An element without a name goes by its kind and its number in the compiled model: ``joint:joint0``.
    """
    kind, _, name = target.partition(":")
    named = [item for item in items if item.name == name]
    if named:
        return named[0]
    spec.compile()  # gives the elements their numbers
    return next(item for item in items if not item.name and f"{kind}{item.id}" == name)
