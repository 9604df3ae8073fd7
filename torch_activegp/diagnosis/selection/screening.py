"""Score test: what would each effect gain, to first order, on top of a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.sensitivities import (
    channels_of,
    effect_columns,
    parameter_columns,
    remembered,
    unit_values,
    units_of,
)
from torch_activegp.diagnosis.selection.smooth_segments import smooth_segments
from torch_activegp.diagnosis.shooting.elimination import (
    SAME_DIRECTION,
    UNSEEN,
    eliminate,
    gained_by,
    invert,
    project,
    scaled,
    wald,
)
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import Linearization, linearize
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.joint import JointEffect

_Row = tuple[Shooting, Fit, Linearization]
_ALIKE = 1e-3
"""Least part of an effect that others do not make up. Of a drive's bias, a constant force on a slide that struck things
left 7e-5, and the two were fitted 50 N and -49 N; of all other corrections there, at least 0.3 was left."""
_ROOM = 1e-9
"""Between amplitudes that may be zero alone."""
_TURNS = 10
"""Rounds of bounded least squares for each amplitude, at most."""
_MOST_BYTES = 60_000_000
"""Of the columns that are tested side by side."""


@dataclasses.dataclass(frozen=True, eq=False)
class Atom:
    """An effect at one of its seeds, and what it would gain.

    Args:
        effect: the effect.
        values: its parameters with the amplitudes that fit best, ``(P,)``.
        gain: decrease of chi2 to first order.
        columns: where its columns stand in the screen's normal matrix.
        seed: the parameters that these columns belong to.
    """

    effect: Effect
    values: Array
    gain: float
    columns: slice
    seed: Array


@dataclasses.dataclass(frozen=True)
class Screen:
    """The result of a score test.

    Args:
        atoms: all of them.
        normal: normal matrix of all columns after states and fitted parameters are projected out, ``(A, A)``.
        gradient: ``(A,)``.
    """

    atoms: tuple[Atom, ...]
    normal: Array
    gradient: Array

    def best(self) -> list[Atom]:
        """The best seed of every effect (name, target and variant), best first."""
        chosen: dict[Effect, Atom] = {}
        for atom in self.atoms:
            if atom.effect not in chosen or atom.gain > chosen[atom.effect].gain:
                chosen[atom.effect] = atom
        return sorted(chosen.values(), key=lambda atom: -atom.gain)

    def times(self, factor: float) -> Screen:
        """The same on so many times the data."""
        atoms = tuple(dataclasses.replace(atom, gain=factor * atom.gain) for atom in self.atoms)
        return Screen(atoms, factor * self.normal, factor * self.gradient)

    def joint_gain(self, atoms: Sequence[Atom]) -> float:
        """What several atoms gain together."""
        return self.together(atoms)[0]

    def possible_gain(self, atoms: Sequence[Atom]) -> float:
        """What several atoms gain together within the bounds of their amplitudes: no damping is below zero."""
        index = _columns_of(atoms)
        matrix, scale = scaled(self.normal[np.ix_(index, index)])
        value, vector = np.linalg.eigh(matrix)
        root = np.sqrt(np.where(value > SAME_DIRECTION, value, np.inf))
        design = np.where(np.isfinite(root), root, 0.0)[:, None] * vector.T
        wanted = vector.T @ (self.gradient[index] / scale) / root
        ends = scale * np.concatenate([_amplitude_bounds(atom) for atom in atoms], axis=1)
        # exact; scipy's other method may never end
        found = optimize.lsq_linear(design, wanted, (ends[0], ends[1]), method="bvls", max_iter=_TURNS * len(wanted))
        return float((wanted**2).sum() - 2.0 * found.cost)

    def losses(self, atoms: Sequence[Atom]) -> list[float]:
        """What the others lose without each of several atoms (Wald statistics)."""
        index = _columns_of(atoms)
        inverse = invert(self.normal[np.ix_(index, index)])
        amplitude = inverse @ self.gradient[index]
        ends = np.cumsum([a.columns.stop - a.columns.start for a in atoms])
        parts = [slice(end - (a.columns.stop - a.columns.start), end) for a, end in zip(atoms, ends, strict=True)]
        return [wald(amplitude[part], inverse[part, part]) for part in parts]

    def independent(self, atoms: Iterable[Atom]) -> list[Atom]:
        """Those of some atoms that no earlier ones make up: a drive's bias makes up a constant force on its joint."""
        kept: list[Atom] = []
        for atom in atoms:
            index = _columns_of([*kept, atom])
            matrix, _ = scaled(self.normal[np.ix_(index, index)])
            left, _ = without(len(index) - (atom.columns.stop - atom.columns.start), matrix, self.gradient[index])
            if np.linalg.eigvalsh(left)[0] > _ALIKE:
                kept.append(atom)
        return kept

    def together(self, atoms: Sequence[Atom]) -> tuple[float, list[Array]]:
        """What several atoms gain together, and the parameters with which they do."""
        index = _columns_of(atoms)
        gain, amplitude = gained_by(self.normal[np.ix_(index, index)], self.gradient[index])
        parts = np.split(amplitude, np.cumsum([a.columns.stop - a.columns.start for a in atoms])[:-1])
        return gain, [_with_amplitude(atom.effect, atom.seed, part) for atom, part in zip(atoms, parts, strict=True)]


def screen(shooting: Shooting, fit: Fit, effects: Sequence[Effect]) -> Screen:
    """Tests every effect at every seed on top of a fit.

    Force laws, changes of inertia and what happens to controls are read off the linearisation around the fit's
    trajectories; simulated is only what acts in steps, or on inertia where not every joint is seen. Columns are made
    for some segments at a time, so that a machine with many joints and a long recording needs little more memory than
    another. Those in which an impact made derivatives of any size are left out (:func:`smooth_segments`).

    Args:
        shooting: the likelihood.
        fit: what is there already.
        effects: what could come.
    """
    linear = linearize(shooting, fit)
    smooth = smooth_segments(shooting, fit, linear)
    if smooth.size < shooting.segments.size:
        here, there, around = shooting.pick(smooth), fit.pick(smooth), linear.pick(smooth)
        return _screened(here, there, around, effects).times(shooting.segments.size / smooth.size)
    return _screened(shooting, fit, linear, effects)


def _screened(shooting: Shooting, fit: Fit, linear: Linearization, effects: Sequence[Effect]) -> Screen:
    """:func:`screen` around a linearisation, on all segments."""
    parts = _parts(shooting, fit.size + sum(map(_width, effects)))

    def rows() -> Iterator[_Row]:
        for some in parts:
            yield shooting.pick(some), fit.pick(some), linear.pick(some)

    seeds = _scanned(channels_of(shooting), rows(), effects)
    plan = [(e, seed) for e in effects for seed in [*e.seeds, *seeds.get(e, [])]]
    wanted = [(e, values) for e, seed in plan for values in unit_values(e, seed)]
    memory = remembered(wanted, shooting)
    normal, gradient = np.zeros((0, 0)), np.zeros(0)
    for part, here, around in rows():
        blocks = (
            around.respond_to_start(),
            parameter_columns(part, here),
            effect_columns(part, here, wanted, around, memory),
        )
        start, held, tested = (part.whiten_columns(block) for block in blocks)
        more, along = project(start, np.concatenate([held, tested], axis=-1), part.residual_of(here))
        normal, gradient = (normal + more, gradient + along) if normal.size else (more, along)
    normal, gradient = without(fit.size, normal, gradient)
    return Screen(tuple(atoms_of(plan, normal, gradient)), normal, gradient)


def atoms_of(plan: Sequence[tuple[Effect, Array]], normal: Array, gradient: Array) -> list[Atom]:
    """What effects at their seeds gain to first order, each with its columns in the normal equations of all."""
    atoms, at = [], 0
    for effect, seed in plan:
        where = slice(at, at + max(effect.linear, 1))
        atoms.append(_atom(effect, seed, where, *gained_by(normal[where, where], gradient[where])))
        if effect.vector and not np.diag(normal)[where].all():  # a component that shows nowhere: the others are enough
            atoms[-1] = dataclasses.replace(atoms[-1], gain=0.0)
        at = where.stop
    return atoms


def allowed(effects: Sequence[Effect], fit: Fit) -> list[Effect]:
    """Those of some effects that may come on top of a fit."""
    taken = fit.keys - {e.key for e in fit.effects if e.more is not None}
    covered = {(name, e.target) for e in fit.effects for name in e.covers}
    return [e for e in effects if not e.stands_in and e.key not in taken and e.key not in covered]


def _width(effect: Effect) -> int:
    return len(effect.seeds) * max(effect.linear, 1)


def _scanned(channel: Mapping[int, int], rows: Iterable[_Row], effects: Sequence[Effect]) -> dict[Effect, Array]:
    """Seeds that the recordings show, of the effects that look for them; channels by degree of freedom."""
    looking = [e for e in effects if isinstance(e, JointEffect) and type(e).scan is not Effect.scan]
    if not looking:
        return {}
    pulls, positions = [], []
    for part, here, around in rows:
        start, white = part.whiten_columns(around.respond_to_start()), part.residual_of(here)
        clean = eliminate(start, start[..., :0], white)
        left = white - np.einsum("smn,sn->sm", clean.basis, np.einsum("smn,sm->sn", clean.basis, white))
        pulls.append(around.pull(part.noise.unwhiten(part.segments, left)))
        positions.append(0.5 * (around.states[:, 1:] + around.states[:, :-1])[..., around.positions])
    out: dict[Effect, Array] = {}
    for effect in looking:
        c = channel[effect.dof]
        position, pull = (np.concatenate([piece[..., c].ravel() for piece in pieces]) for pieces in (positions, pulls))
        sound = np.isfinite(position) & np.isfinite(pull)
        out[effect] = effect.scan(position[sound], pull[sound])
    return out


def _atom(effect: Effect, seed: Array, where: slice, gain: float, amplitude: Array) -> Atom:
    values = _with_amplitude(effect, seed, amplitude)
    wanted = np.any(values[: effect.linear]) if effect.linear else amplitude[0] > 0.0
    if wanted and _is_a_size(effect):  # all seeds of a small one gain the same: the one that comes near it leads
        gain *= max(1.0 - (1.0 - values[0] / (seed[0] * amplitude[0])) ** 2, 0.0)
    return Atom(effect, values, gain if wanted else 0.0, where, seed)


def _is_a_size(effect: Effect) -> bool:
    """Whether all that an effect has is a size without an amplitude, such as a delay's."""
    return not effect.linear and len(effect.parameters) == 1 and not effect.parameters[0].place


def _amplitude_bounds(atom: Atom) -> Array:
    """Least and largest amplitudes in units of its columns, ``(2, n)``."""
    effect, count = atom.effect, atom.columns.stop - atom.columns.start
    if not effect.linear:
        return np.array([[0.0], [np.inf]])
    ends = np.array([[p.low, p.high] for p in effect.parameters[:count]]).T / units_of(effect, atom.seed)
    return np.sort(ends, axis=0) + np.array([[-_ROOM], [_ROOM]])


def _with_amplitude(effect: Effect, seed: Array, amplitude: Array) -> Array:
    values = seed.copy()
    if effect.linear:
        values[: effect.linear] = amplitude * units_of(effect, seed)
    elif _is_a_size(effect):
        values *= _share(float(seed[0]), np.unique(effect.seeds), float(amplitude[0]))
    return np.clip(values, [p.low for p in effect.parameters], [p.high for p in effect.parameters])


def _share(size: float, sizes: Array, wanted: float) -> float:
    """How much of a mere size, such as a delay, to begin from: what does as much as the recordings want.

    It ends at the sizes next to it, which say more about their surroundings.
    """
    if sizes[0] <= 0.0 or wanted <= 0.0:
        return 1.0
    at = int(np.searchsorted(sizes, size))
    least, most = (sizes[at - 1] if at else 0.0), sizes[min(at + 1, len(sizes) - 1)]
    return float(np.clip(wanted, least / size, most / size))


def _parts(shooting: Shooting, columns: int) -> list[NDArray[np.int64]]:
    """Segments to test side by side: as many as have room."""
    segments = shooting.segments
    each = (segments.intervals + 1) * segments.position.shape[-1] * max(columns, 1) * 8
    count = int(np.ceil(segments.size * each / _MOST_BYTES))
    return np.array_split(np.arange(segments.size), min(max(count, 1), segments.size))


def without(count: int, normal: Array, gradient: Array) -> tuple[Array, Array]:
    """Normal equations after the first parameters, such as those that are fitted already, are projected out too.

    What shows nowhere, or is what they do, has zeros: its rounding errors would be taken for something.
    """
    along = normal[count:, :count] @ invert(normal[:count, :count])
    rest, pull = normal[count:, count:] - along @ normal[:count, count:], gradient[count:] - along @ gradient[:count]
    seen = np.diag(rest) > np.maximum(UNSEEN, UNSEEN * np.diag(normal)[count:])
    return np.where(seen[:, None] & seen, rest, 0.0), np.where(seen, pull, 0.0)


def _columns_of(atoms: Sequence[Atom]) -> NDArray[np.int64]:
    """Where the columns of some atoms stand in the normal matrix."""
    return np.concatenate([np.arange(atom.columns.start, atom.columns.stop) for atom in atoms])
