"""A pendulum that is shaken at random, beside a damping that its model leaves out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.conftest import INERTIA, RATE, XML, Bench, assemble
from torch_activegp.data import Recording
from torch_activegp.diagnosis.selection import process_left as module
from torch_activegp.diagnosis.selection.process_left import by_positions, process_behind
from torch_activegp.diagnosis.shooting.fit import Fit

DAMPING, NOISE, SUBSTEPS = 0.6, 2e-5, 5


def record(density: float, seed: int) -> Recording:
    """A run of 6 s by the semi-implicit Euler scheme of second order, kicked in every step."""
    rng, h = np.random.default_rng(seed), 1 / RATE / SUBSTEPS
    time = np.arange(6 * RATE + 1) / RATE
    control = 1.5 * np.sin(2 * np.pi * rng.uniform(0.3, 1.5, 3) * time[:, None] + rng.uniform(0, 6, 3)).sum(axis=1)
    q, v, angles = rng.normal(0.0, 0.5), 0.0, []
    for u in control:
        angles.append(q)
        for _ in range(SUBSTEPS):
            q += h / 2 * v
            force = u - 9.81 * 0.5 * np.sin(q)
            half = 0.5 * h * DAMPING / INERTIA
            v = ((1 - half) * v + h * force / INERTIA) / (1 + half) + density * np.sqrt(h) * rng.normal()
            q += h / 2 * v
    noisy = np.array(angles) + NOISE * rng.normal(size=len(time))
    return Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": noisy, "ctrl.drive": control})


def shaken(density: float) -> tuple[Bench, Fit]:
    """The likelihood by the noise of positions, and the fit of the right name."""
    bench = assemble(f"shaken {density}", XML, [record(density, i) for i in range(3)], record(density, 9))
    noise = dataclasses.replace(bench.shooting.noise, scale=np.array([NOISE]))
    shooting = dataclasses.replace(bench.shooting, noise=noise)
    nominal = shooting.fit([((), ())], bench.nominal.starts)[0]
    bench = dataclasses.replace(bench, shooting=shooting, nominal=nominal)
    return bench, bench.fit("viscous_friction", 0.1)


def test_what_right_names_leave_is_process_noise_and_their_parameters_are_judged_by_it() -> None:
    bench, fit = shaken(0.03)
    found = process_behind(bench.shooting, bench.nominal, fit)
    assert found is not None and found.process is not None
    assert found.process[0] == pytest.approx(0.03, rel=0.25)
    assert found.scale[0] == NOISE
    again = dataclasses.replace(bench.shooting, noise=found)
    told = again.fit([(fit.effects, fit.values)], fit.starts)[0]
    assert told.chi2 == pytest.approx(again.dof, rel=0.15)
    assert by_positions(again, told)[1].chi2 == pytest.approx(fit.chi2, rel=0.1)
    assert by_positions(again, told)[0].noise.process is None
    assert by_positions(bench.shooting, fit) == (bench.shooting, fit)
    off = [float(f.values[0][0]) - DAMPING for f in (told, fit)]
    error = [1.0 / np.sqrt(float(f.information[0, 0])) for f in (told, fit)]
    assert abs(off[0]) < 2.5 * error[0] < 0.1 * DAMPING
    assert abs(off[1]) > 5.0 * error[1]  # as noise of positions it makes parameters seem far surer than they are


def test_little_left_or_much_of_the_mismatch_or_of_the_forces_is_no_process_noise(monkeypatch) -> None:
    bench, fit = shaken(0.0)
    assert process_behind(bench.shooting, bench.nominal, fit) is None  # noise alone
    bench, fit = shaken(0.03)
    assert process_behind(bench.shooting, bench.nominal, bench.nominal) is None  # no name
    near = bench.shooting.fit([(fit.effects, [0.9 * value for value in fit.values])], fit.starts, hold=True)[0]
    assert fit.chi2 < 0.1 * near.chi2
    assert process_behind(bench.shooting, near, fit) is None  # physics, maybe
    filtered = dataclasses.replace(bench.shooting.noise, colour=np.array([[0.5, 0.0]]))
    coloured = dataclasses.replace(bench.shooting, noise=filtered)
    assert process_behind(coloured, bench.nominal, fit) is None
    gone = dataclasses.replace(fit, starts=fit.starts * np.nan)
    assert process_behind(bench.shooting, bench.nominal, gone) is None
    monkeypatch.setattr(module, "MAX_EFFECTS", 1)
    assert process_behind(bench.shooting, bench.nominal, fit) is None  # as many names as are tried
    monkeypatch.undo()
    assert process_behind(bench.shooting, bench.nominal, fit) is not None
    monkeypatch.setattr(module, "_STILL_TOLD", 1e6)
    assert process_behind(bench.shooting, bench.nominal, fit) is None  # the nominal leaves little more, as a force
