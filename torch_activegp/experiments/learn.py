"""Learning from recordings: a GP whose mean is the simulator, and how much better it forecasts what it has not seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from tensordict import TensorDict
from torch import Tensor

from torch_activegp.data import Recording, noise_std
from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.experiments.additive_kernel import additive_matern
from torch_activegp.experiments.control_step import choose_step
from torch_activegp.experiments.coverage import farthest_points
from torch_activegp.experiments.forecast import Forecast, forecast, positions_of, signal_scale
from torch_activegp.experiments.nominal import nominal_simulator
from torch_activegp.experiments.recorded import (
    check_apart,
    check_columns_known,
    set_aside,
    with_velocities,
)
from torch_activegp.experiments.transitions import transitions_of
from torch_activegp.experiments.window_guard import cut_windows, guard_windows
from torch_activegp.keys import ACTION, STATE
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import (
    DynamicsGP,
    FitResult,
    GuardReport,
    HeldOutGuard,
    LearnedNoise,
    LearnedSimulator,
    fit_hyperparameters,
)
from torch_activegp.simulators import Simulator

WINDOW = 1.0
"""Length of the windows that forecasts are compared over, s."""

_FEWEST = 20
_BLOCKS, _EVERY, _KEPT = 10, 5, 2
_OVERSAMPLE = 2


@dataclass(frozen=True)
class Learned:
    """A learned model and what it is worth.

    Attributes:
        model: how the user named the simulator.
        external_force: whether the action holds the joints' external forces.
        simulator: the simulator alone, at the model's time step.
        learned: simulator + GP.
        fit: what the fit of the hyper-parameters arrived at.
        guard: one-step errors on the part of the training data that the guard kept; where it hurts, the correction of a
            state is shrunk.
        window_guard: a sentence about windows of the same part: whether they were forecast worse than by the simulator
            alone, and the correction was shrunk for it.
        before: the simulator's forecast of the held-out runs.
        after: that of simulator + GP.
        runs: the held-out runs as transitions; ``time`` begins at 0.
        labels: their names.
        scale: standard deviation of each held-out state, ``(d,)``: the unit of normalised errors.
        noise: measurement noise of the held-out positions, root mean square in that unit.
        notes: what had to be decided, in sentences.
    """

    model: str
    external_force: bool
    simulator: Simulator
    learned: LearnedSimulator
    fit: FitResult
    guard: GuardReport
    window_guard: str
    before: Forecast
    after: Forecast
    runs: tuple[TensorDict, ...]
    labels: tuple[str, ...]
    scale: Tensor
    noise: float
    notes: tuple[str, ...] = field(default=())


def learn(
    model: str,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    *,
    dt: float | None = None,
    max_points: int = 800,
    seed: int = 0,
) -> Learned:
    """Learn where a simulator is wrong from recordings, and compare both on recordings that were held out.

    Velocities that were not recorded are estimated. A fifth of the training data, in blocks of up to a second spread
    over each run, is kept for the guard; of the rest, the ``max_points`` transitions that cover states and actions best
    are learned from. Angles are taken on the circle, in states and in inputs.

    Args:
        model: an MJCF file, ``package.module:factory``, or ``emps``; see
            :func:`~torch_activegp.experiments.nominal.nominal_simulator`.
        recordings: to learn from.
        holdout: to compare on; without them a part is set aside, and the notes say which.
        dt: time step of the model, s; None chooses it from the recordings
            (:func:`~torch_activegp.experiments.control_step.choose_step`), or takes that of a factory's simulator.
        max_points: transitions that the GP is conditioned on, at most.
        seed: of every random draw.

    Returns:
        The model, its errors, and what was decided on the way.

    Raises:
        ConfigurationError: the model or an option cannot be used.
        DataError: a recording is too short, does not fit the model, or is both learned from and held out.
        SimulationError: the simulator is not finite at a recorded state.
    """
    if max_points < _FEWEST:
        raise ConfigurationError(f"--max-points: wanted at least {_FEWEST}, found {max_points}.")
    check_apart(recordings, holdout)
    notes: list[str] = []
    if not holdout:
        recordings, holdout, note = set_aside(recordings)
        notes.append(note)
    forced = any(column.startswith("qfrc.") for recording in (*recordings, *holdout) for column in recording.columns)
    nominal = nominal_simulator(model, external_force=forced)
    check_columns_known([*recordings, *holdout], nominal, model)
    train = [with_velocities(recording, nominal) for recording in recordings]
    test = [with_velocities(recording, nominal) for recording in holdout]
    notes += dict.fromkeys(f"{recording.label}: {note}" for recording in (*train, *test) for note in recording.notes)
    dt = dt if dt is not None else _own_step(model, nominal) or choose_step(train)
    simulator = nominal_simulator(model, dt, external_force=forced)
    learned, fit, guard = _fit(simulator, train, max_points, seed)
    notes.append(
        f"Time step {simulator.dt:.6g} s; learned from {learned.gp.num_points} transitions of "
        f"{', '.join(recording.label for recording in train)}."
    )
    learned, window_guard = _guard_windows(simulator, learned, train)
    runs = [transitions_of(recording, simulator) for recording in test]
    scale = signal_scale(simulator, [run[STATE] for run in runs])
    return Learned(
        model=model,
        external_force=forced,
        simulator=simulator,
        learned=learned,
        fit=fit,
        guard=guard,
        window_guard=window_guard,
        before=forecast(simulator, runs, WINDOW, scale),
        after=forecast(learned, runs, WINDOW, scale),
        runs=tuple(runs),
        labels=tuple(recording.label for recording in test),
        scale=scale,
        noise=_noise(simulator, test, scale),
        notes=tuple(notes),
    )


def build_gp(simulator: Simulator, low: Tensor, high: Tensor) -> DynamicsGP:
    """The GP of :func:`learn` before it has seen data, for inputs between ``low`` and ``high`` ``(D,)``."""
    kernel = additive_matern(low, high, simulator.state_space.angles)
    return DynamicsGP(EpisodicMean(SimulatorMean(simulator), "bayes"), kernel, noise=LearnedNoise())


def _own_step(model: str, simulator: Simulator) -> float | None:
    """The step that a factory gave its simulator; an MJCF model takes any."""
    return simulator.dt if ":" in model else None


def _fit(
    simulator: Simulator, train: Sequence[Recording], max_points: int, seed: int
) -> tuple[LearnedSimulator, FitResult, GuardReport]:
    seconds = sum(float(recording.time[-1] - recording.time[0]) for recording in train)
    shifts = math.ceil(_OVERSAMPLE * max_points * simulator.dt / seconds)
    data = [transitions_of(recording, simulator, shifts) for recording in train]
    kept = [_guard_rows(recording, run["time"], simulator.dt) for recording, run in zip(train, data, strict=True)]
    taught: TensorDict = torch.cat([run[~rows] for run, rows in zip(data, kept, strict=True)])
    unseen: TensorDict = torch.cat([run[rows] for run, rows in zip(data, kept, strict=True)])
    if len(taught) < _FEWEST or not len(unseen):
        raise DataError(
            f"{', '.join(recording.label for recording in train)}: too short, {len(taught)} transitions of "
            f"{simulator.dt:.6g} s to learn from and {len(unseen)} to check them, at least {_FEWEST} and 1 wanted. "
            "Record longer, or take a smaller --dt."
        )
    points = torch.cat([taught[STATE], taught[ACTION]], dim=-1)
    chosen = taught[farthest_points(points, max_points, seed)]
    gp = build_gp(simulator, points.amin(0), points.amax(0))
    gp.update(chosen[STATE], chosen[ACTION], chosen["next", STATE])
    fit = fit_hyperparameters(gp, generator=torch.Generator().manual_seed(seed))
    guard = HeldOutGuard(gp.num_outputs, simulator.state_space.names)
    guard.observe_transitions(gp, unseen[STATE], unseen[ACTION], unseen["next", STATE])
    report = guard.report()
    return LearnedSimulator(gp, simulator.action_space, simulator.dt, report.trust), fit, report


def _guard_windows(
    simulator: Simulator, learned: LearnedSimulator, train: Sequence[Recording]
) -> tuple[LearnedSimulator, str]:
    runs = [transitions_of(recording, simulator) for recording in train]
    kept = [_guard_rows(recording, run["time"], simulator.dt) for recording, run in zip(train, runs, strict=True)]
    scale = signal_scale(simulator, [run[STATE] for run in runs])
    return guard_windows(simulator, learned, cut_windows(runs, kept), scale)


def _guard_rows(recording: Recording, time: Tensor, dt: float) -> Tensor:
    """Which transitions of a run the guard keeps: every fifth block of a second, or of a tenth of a short run."""
    duration = float(recording.time[-1] - recording.time[0])
    block = max(min(WINDOW, duration / _BLOCKS), dt)
    return torch.floor(time / block + 1e-6).long() % _EVERY == _KEPT


def _noise(simulator: Simulator, recordings: Sequence[Recording], scale: Tensor) -> float:
    names = simulator.state_space.names
    variance = [
        (noise_std(recording[names[index]], recording.time) / float(scale[index])) ** 2
        for recording in recordings
        for index in positions_of(simulator)
        if len(recording) > 8
    ]
    return math.sqrt(sum(variance) / len(variance)) if variance else math.nan
