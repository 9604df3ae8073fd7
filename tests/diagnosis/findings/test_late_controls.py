from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from torch_activegp.data import ColumnMap
from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.findings import late_controls as module
from torch_activegp.diagnosis.findings.late_controls import doubt_rows
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import NOMINAL


def explained(clean, rows: float, driven: bool = True) -> Explanation:
    """What the model itself would have recorded with little noise, its controls so many rows late; nothing is named.

    Half a row late are the samples of a command that changes evenly.
    """
    acted = clean.segments
    if rows == 0.5:
        means = [0.5 * (run.control + np.vstack([run.control[1:], run.control[-1:]])) for run in acted.runs]
        runs = (dataclasses.replace(run, control=mean) for run, mean in zip(acted.runs, means, strict=True))
        acted = dataclasses.replace(acted, runs=tuple(runs))
    seen = clean.engine.predict(acted, clean.nominal.starts[None], [NOMINAL])[0]
    noise = 0.02 * clean.noise
    position = seen + noise * np.random.default_rng(0).normal(size=seen.shape)

    def late(control: np.ndarray) -> np.ndarray:
        index = np.clip(np.arange(len(control)) - int(rows), 0, len(control) - 1)
        return control[index] if driven else 0.0 * control

    runs = tuple(dataclasses.replace(run, control=late(run.control)) for run in clean.segments.runs)
    segments = dataclasses.replace(clean.segments, runs=runs, position=position)
    shooting = Shooting(clean.engine, segments, NoiseModel.white(np.array([noise])))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    selection = Selection(nominal, [nominal], Score(shooting.samples, 60, 1.0))
    return Explanation(clean.engine, shooting, selection, (), given=clean.engine)


def test_of_readings_that_leave_as_much_the_simpler_one_is_told() -> None:
    one, other = module._READINGS[1:]
    for left, told in ((1.0, one), (0.96, one), (0.94, other)):
        assert module._better(((1.0, 5.0), one), ((left, 5.0), other))[1] is told


def test_smooth_commands_are_means_of_a_spline_through_their_rows(clean) -> None:
    run = clean.machine.fit[0]
    wave = np.sin(20.0 * run.time[:-1, None])
    steps = np.diff(run.time)[:, None]
    means = (np.cos(20.0 * run.time[:-1, None]) - np.cos(20.0 * run.time[1:, None])) / (20.0 * steps)
    found = module._smoothly(dataclasses.replace(run, control=wave)).control
    even = module._evenly(dataclasses.replace(run, control=wave)).control
    assert np.abs(found - means)[3:-3].max() < 1e-4 < np.abs(even - means)[3:-3].max()
    few = {name: getattr(run, name)[:4] for name in ("time", "recorded", "position")}
    short = dataclasses.replace(run, control=wave[:3], force=run.force[:3], **few)
    np.testing.assert_array_equal(module._smoothly(short).control, module._evenly(short).control)


def test_controls_of_a_slower_run_change_to_its_next_row(clean) -> None:
    """As `hold_order` has it: on the clock of a faster one each row of it is two."""
    run = clean.machine.fit[0]
    held = np.repeat(np.arange(len(run) // 2), 2)[: len(run) - 1, None].astype(float)
    slow = dataclasses.replace(run, control=held, recorded=np.arange(len(run)) % 2 == 0)
    np.testing.assert_array_equal(module._evenly(slow).control[:-4], held[:-4] + 0.5)
    np.testing.assert_allclose(
        module._smoothly(slow).control[:-4, 0], held[:-4, 0] + 0.25 + 0.5 * (np.arange(len(held) - 4) % 2)
    )


@pytest.mark.parametrize(
    ("rows", "setting", "words"),
    [(1, "rows_late", "a row late"), (0.5, "hold_order", "change evenly"), (0, "", ""), (-1, "", "")],
)
def test_controls_a_row_late_and_those_that_change_evenly_are_told_apart(clean, rows, setting: str, words: str) -> None:
    found = doubt_rows(explained(clean, rows))
    assert bool(found) == bool(setting)
    if found:
        assert f"ctrl.drive = {{ {setting} = 1 }}, with what is there." in found[0]
        assert words in found[0]


def test_rows_are_not_doubted_where_a_row_earlier_leaves_much_too(clean, monkeypatch) -> None:
    found = explained(clean, 1)
    monkeypatch.setattr(module, "MUCH_LEFT", 0.1)
    for better, said in ((1.0, True), (1e-9, False)):
        monkeypatch.setattr(module, "_MUCH_BETTER", better)
        assert bool(doubt_rows(found)) is said


def test_all_segments_are_fitted_only_where_a_part_of_them_says_so(clean, monkeypatch) -> None:
    sizes: list[int] = []
    fit = Shooting.fit

    def counted(self, *args, **options):
        sizes.append(self.segments.size)
        return fit(self, *args, **options)

    monkeypatch.setattr("torch_activegp.diagnosis.findings.changed_controls.enough", lambda engine, segments: 0.3)
    for rows, whole in ((0, False), (1, True)):
        found = explained(clean, rows)
        with monkeypatch.context() as patch:
            patch.setattr(Shooting, "fit", counted)
            doubt_rows(found)
        assert sizes[0] < clean.segments.size
        assert (clean.segments.size in sizes) == whole
        sizes.clear()


def test_nothing_is_said_where_nothing_is_driven(clean) -> None:
    assert doubt_rows(explained(clean, 1, driven=False)) == []


def test_a_log_of_commands_that_led_to_their_rows_is_told_first(record, model) -> None:
    """Whole diagnoses: the mismatch is unknown, and the sentence says what to look at."""
    runs = []
    for seed in range(4):
        control = record("none", seed)["ctrl.drive"].numpy()
        runs.append(record("none", seed, ctrl__drive=np.concatenate([control[:1], control[:-1]])))
    found = diagnose(model, runs, nthread=1)
    assert found.verdict == "unknown"
    assert "Check the recordings first: The controls seem to be logged a row late" in found.sentence


@pytest.mark.parametrize(
    ("name", "seconds", "order", "said"),
    [
        ("actuator_delay", 0.005, 1, True),
        ("actuator_delay", 0.0062, 3, True),
        ("actuator_delay", 0.008, 1, False),
        ("actuator_delay", 0.005, 0, False),
        ("viscous_friction", 0.005, 1, False),
    ],
)
def test_a_delay_of_half_a_row_is_doubted_where_controls_are_not_held(bench, name, seconds, order, said: bool) -> None:
    effect = bench.effect(name, "actuator:drive" if name == "actuator_delay" else "joint:hip")
    judgement = SimpleNamespace(named=(effect,), fit=SimpleNamespace(by_effect={effect: np.array([seconds])}))
    columns = ColumnMap.from_mapping({"ctrl.drive": {"hold_order": order}, "time": "t"})
    notes = columns.notes(pd.DataFrame({"t": [0.0], "ctrl.drive": [0.0]}))
    found = module.half_a_row(judgement, [f"run: {note}" for note in notes], 0.01)
    assert bool(found) is said
    if said:
        assert "actuator_delay at actuator:drive is about half a row (5 ms)" in found[0]
