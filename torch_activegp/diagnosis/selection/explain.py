"""From runs to the set of effects that explains them: noise, numerics, length of segments, selection."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.checkpoint import Checkpoint
from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.brief_pieces import closest
from torch_activegp.diagnosis.preparation.given_numerics import numerics_of
from torch_activegp.diagnosis.preparation.lengths import Lengths, longest
from torch_activegp.diagnosis.preparation.noise_left import noise_behind, raised
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.corrections import correct_alike
from torch_activegp.diagnosis.selection.finer_steps import nameless_in_finer_steps, of_a_step, without_a_step
from torch_activegp.diagnosis.selection.first_names import Naming, besides, in_brief_pieces, is_of, leaders, on_a_part
from torch_activegp.diagnosis.selection.held_forces import of_held_forces
from torch_activegp.diagnosis.selection.longer_segments import SHORTEST, TIMES, Found, in_longer_segments, shows
from torch_activegp.diagnosis.selection.one_law import with_one_law
from torch_activegp.diagnosis.selection.own_errors import by_their_own_errors
from torch_activegp.diagnosis.selection.polish import polish
from torch_activegp.diagnosis.selection.process_left import process_behind
from torch_activegp.diagnosis.selection.prospects import hopeless
from torch_activegp.diagnosis.selection.search import select
from torch_activegp.diagnosis.selection.start import NO_FURTHER, TOO_FAR, WHOLE, Start, Tell, once_more, with_noise
from torch_activegp.diagnosis.selection.static_friction import try_static_friction
from torch_activegp.diagnosis.selection.weak import also_weak, with_weak
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.errors import SimulationError
from torch_activegp.physics.effect import Effect

_FAR = 60.0
"""As :data:`TOO_FAR`, for the first names."""
_LED = 3.0
"""Times the noise up to which names found in brief pieces need no part of the data any more."""
_ANEW = 3
"""How often noise is taken anew behind what all data say."""
_LONGER = 2
"""How often segments are made longer behind what all data say."""
_AGAIN = 3
"""How often numerics are looked at again behind new names."""
_SETTLED = 0.8
"""And not behind those that they were chosen behind, unless these leave less than this part of what they left then."""


@dataclasses.dataclass(frozen=True)
class Explanation:
    """The sets that were compared, and what they were compared with.

    Args:
        engine: the precise simulation.
        shooting: the likelihood in the end.
        selection: the sets.
        effects: all that was tried.
        given: that by the model's own integrator and time step.
        firm: whether the dry friction of its own joints stuck firmly.
    """

    engine: Engine
    shooting: Shooting
    selection: Selection
    effects: tuple[Effect, ...]
    given: Engine
    firm: bool = False

    @property
    def fine(self) -> bool:
        """Whether the model was integrated in another way than it says."""
        return self.engine is not self.given


def explain(
    machine: Machine,
    effects: Sequence[Effect],
    nthread: int = 0,
    tell: Tell = lambda _: None,
    checkpoint: Checkpoint | None = None,
) -> Explanation:
    """Names what the model leaves out.

    Args:
        machine: model and runs.
        effects: what is tried.
        nthread: threads of the simulations; 0 for all cores.
        tell: hears what is being done.
        checkpoint: keeps finished stages.
    """
    numerics = numerics_of(machine, nthread)
    keep = checkpoint or Checkpoint()
    keep.share([*numerics.all, *machine.fit, *(form for effect in effects for form in effect.family())])
    tell("noise floor")
    noise = noise_floor(machine.fit)
    numerics = dataclasses.replace(numerics, coarse=closest(numerics, machine, noise))

    work = _OnAllData(machine, numerics, effects, tell)

    def begin() -> Start:
        long = keep.once("length of segments", lambda: longest(machine, numerics, noise, _FAR))
        return _start(machine, numerics, noise, effects, long, tell)

    def name() -> tuple[Start, Selection]:
        return work.name(keep.once("naming on a part of the data", begin), noise)

    def finish() -> Explanation:
        return _finish(numerics, effects, *keep.once("naming on all data", name), tell)

    return keep.once("naming", finish)


@dataclasses.dataclass(frozen=True)
class _OnAllData:
    """Naming on all data: what is looked at, and what is tried."""

    machine: Machine
    numerics: Numerics
    effects: Sequence[Effect]
    tell: Tell

    def name(self, start: Start, floor: NoiseModel) -> tuple[Start, Selection]:
        """The names on all data, and what they began from in the end, from the noise there seemed to be at first."""
        first = start.first
        floor = raised(floor, start.noise)
        if first.effects and (other := noise_behind(start.shooting, first, floor)) is not None:
            floor = raised(floor, other)
            start = with_noise(self.machine, self.numerics, start, first, start.sets, start.free, other, self.tell)
        self.tell("naming on all data")
        start, selection, as_begun = self._in_any(start)
        turn = 1
        while (
            turn <= _ANEW and (other := noise_behind(start.shooting, selection.best, floor, turn == _ANEW)) is not None
        ):
            floor, turn = raised(floor, other), turn + 1
            start, selection = self._behind(start, selection, other)
        shaken = process_behind(start.shooting, start.nominal, selection.best) if as_begun else None
        return (start, selection) if shaken is None else self._behind(start, selection, shaken)

    def _in_any(self, begun: Start) -> tuple[Start, Selection, bool]:
        """The names in segments as long as they want, what they began from, and whether that is what was given.

        The set that was given is asked in segments of a second, or none in longer ones; what is found, in longer ones.
        """
        named = bool(begun.first.effects)
        start = self._longer(begun, (begun.first, begun.sets, begun.free), SHORTEST if named else TIMES)
        start = dataclasses.replace(start, depth=begun.depth)  # nothing was searched yet
        as_begun, selection = start.shooting is begun.shooting, self._select(start)
        if not (as_begun or named or shows(start, selection.best)):
            start, selection, as_begun = begun, self._select(begun), True
        for _ in range(_LONGER if named or selection.best.effects else 0):
            best = selection.best
            longer = self._longer(start, (best, besides(leaders(selection), best), selection.score.free))
            if longer is start:
                break
            start, selection, as_begun = longer, self._select(longer), False
        return start, selection, as_begun

    def _longer(self, start: Start, found: Found, times: Sequence[int] = TIMES) -> Start:
        """The same over longer segments where a set leaves more than noise in them."""
        longer = in_longer_segments(self.machine, self.numerics, start, found, times)
        if longer is None:
            return start
        self.tell("naming in longer segments")
        return longer

    def _select(self, start: Start) -> Selection:
        _refuse_failed(start.shooting.segments, start.nominal, self.machine)
        tried, tell = self.effects, self.tell
        found = select(start.shooting, tried, start.nominal, start.sets, start.first, tell, start.free, start.depth)
        return with_weak(start.shooting, found)

    def _behind(self, start: Start, selection: Selection, noise: NoiseModel) -> tuple[Start, Selection]:
        """The same by another noise."""
        best, free = selection.best, selection.score.free
        rest = besides(leaders(selection), best)
        start = with_noise(self.machine, self.numerics, start, best, rest, free, noise, self.tell)
        start = dataclasses.replace(start, depth=once_more(start.depth))
        return start, self._select(start)


def _start(
    machine: Machine,
    numerics: Numerics,
    noise: NoiseModel,
    effects: Sequence[Effect],
    long: Lengths,
    tell: Tell,
) -> Start:
    """Names on a part of the data where there is much to explain, and in brief pieces before where it is very much."""
    segments, first = long.segments, long.nominal
    far = bool(first.chi2 > TOO_FAR * segments.counts.sum() * segments.position.shape[-1])
    hint = in_brief_pieces(machine, numerics, noise, effects, tell) if far else None
    sets, free = (hint.sets, hint.free) if hint is not None else ([], frozenset())
    naming = Naming(*numerics.choose(segments, noise, first, first, sets), sets, free)
    _refuse_failed(naming.shooting.segments, naming.nominal, machine)
    if not sets and (other := noise_behind(naming.shooting, naming.judged, noise, last=True)) is not None:
        noise, long = other, longest(machine, numerics, other, _FAR)
        segments, first = long.segments, long.nominal
        naming = Naming(*numerics.choose(segments, noise, first, first))
    engine, shooting, nominal, judged = naming.engine, naming.shooting, naming.nominal, naming.judged
    if naming.wants_a_part and not (hint is not None and judged.chi2 < _LED * shooting.dof):
        tell("naming on a part of the data")
        naming = on_a_part(naming, numerics, noise, effects, tell)
        engine, shooting, nominal, judged = naming.engine, naming.shooting, naming.nominal, naming.judged
        sets, astray = naming.sets, naming.lost or naming.in_vain
        used = shooting.segments
        near = long.halved and not naming.in_vain and bool(used.far_off(nominal.per_segment, _FAR / 4).any())
        fewer = longest(machine, numerics, noise, TOO_FAR, long) if near else long
        longer = fewer.segments.size < segments.size
        if longer:
            used, nominal = fewer.segments, fewer.nominal
        new = naming.best != frozenset(judged.effects)
        if longer or (new and not astray):
            sought, only = ([], None) if astray else (sets, None if new else engine)
            engine, shooting, nominal, judged = numerics.choose(used, noise, nominal, nominal, sought, only=only)
    aside = hint.yet_to_try(judged, shooting) if hint is not None else []
    rest = besides([*sets[: 1 if naming.in_vain else None], *aside], judged)
    depth = NO_FURTHER if naming.in_vain else WHOLE
    return Start(engine, shooting, nominal, rest, judged, naming.free, noise, depth)


def _finish(
    numerics: Numerics, effects: Sequence[Effect], start: Start, selection: Selection, tell: Tell
) -> Explanation:
    """Looks at the numerics once more behind the effects, unless chosen behind these, or these explain little."""
    engine, shooting, nominal, judged = start.engine, start.shooting, start.nominal, start.first
    for _ in range(_AGAIN):
        best, first = selection.best, leaders(selection)
        quiet = best.chi2 < NOISE_ALONE * shooting.dof
        same = is_of(judged, best.effects) and (quiet or best.chi2 > _SETTLED * judged.chi2)
        settled = not best.effects or same
        lost = (selection.cut_short and not quiet) or hopeless(selection, shooting)
        if not (settled or lost):
            known = (engine, shooting)
            again, other, bare, judged = numerics.choose(shooting.segments, shooting.noise, best, nominal, first, known)
            if again is not engine and np.isfinite(bare.chi2):
                engine, shooting, nominal = again, other, bare
                tell("naming with the numerics seen behind the effects")
                rest = besides(first, judged)
                depth = once_more(start.depth)
                chosen = select(shooting, effects, bare, rest, judged, tell, selection.score.free, depth)
                selection = with_weak(shooting, chosen)
        before, selection = selection.best, also_weak(shooting, selection, effects, tell)
        found = selection.best
        if set(found.effects) == set(before.effects) and not found.chi2 < _SETTLED * before.chi2:
            break
    selection = without_a_step(numerics, engine, shooting, selection)
    if (nameless := nameless_in_finer_steps(numerics, engine, shooting, selection)) is not None:
        engine, (shooting, selection) = nameless[0].engine, nameless
    else:
        correct_alike(selection, shooting, effects)
        try_static_friction(shooting, selection, effects)
        polish(shooting, selection, effects)
        shooting = by_their_own_errors(shooting, engine, selection)
        selection = with_one_law(shooting, selection, effects)
        try_static_friction(shooting, selection, effects)  # once more: fits beside the best ones were forgotten
        held = of_held_forces(numerics, engine, shooting, selection)
        selection.of_a_step = held | of_a_step(numerics, engine, shooting, selection)  # of what came first in the end
    return Explanation(engine, shooting, selection, tuple(effects), numerics.given, numerics.sticks(engine))


def _refuse_failed(segments: Segments, nominal: Fit, machine: Machine) -> None:
    """Raises a `SimulationError` where nothing can be compared: the simulation fails without effects."""
    if np.isfinite(nominal.chi2):
        return
    worst = int(np.argmax(nominal.per_segment))
    run, first = segments.runs[segments.run[worst]], segments.first[worst]
    check = "Its forecasts begin at the recorded positions there: check that it can simulate them."
    doubted = (*machine.doubts, *machine.undriven)
    doubts = f"Check the recordings first: {doubted[0]}" if doubted else check
    raise SimulationError(
        f"diagnose: the simulator fails in {run.label} after {run.time[first]:.3g} s (its state is no number, or a "
        f"warning was raised). {doubts}"
    )
