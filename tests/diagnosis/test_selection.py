from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.compared import Selection
from torch_activegp.diagnosis.machine import make_machine
from torch_activegp.diagnosis.noise_model import NoiseModel
from torch_activegp.diagnosis.segments import cut
from torch_activegp.diagnosis.selection import select
from torch_activegp.diagnosis.shooting import Shooting

NAMES = ("viscous_friction", "coulomb_friction", "quadratic_drag", "constant_force", "armature_error")
FINE = 1e-4


@pytest.fixture(scope="module")
def selection(bench) -> Selection:
    return select(bench.shooting, [bench.effect(name) for name in NAMES], bench.nominal)


def test_the_injected_effect_alone_is_chosen(bench, selection) -> None:
    assert selection.best.keys == {("viscous_friction", "joint:hip")}
    assert selection.best.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    assert selection.ranked()[0] is selection.best
    assert len({fit.keys for fit in selection.ranked()}) == len(selection.ranked())


def test_rivals_and_the_nominal_were_compared(bench, selection) -> None:
    compared = {fit.keys for fit in selection.ranked()}
    assert frozenset() in compared
    assert frozenset({("quadratic_drag", "joint:hip")}) in compared
    assert selection.score(selection.best) + 20 < selection.score(bench.nominal)


def test_nothing_is_chosen_where_nothing_is_missing(clean) -> None:
    chosen = select(clean.shooting, [clean.effect(name) for name in NAMES], clean.nominal)
    assert chosen.best.effects == ()


def test_a_useless_set_to_begin_from_is_left_behind(bench) -> None:
    load = bench.effect("constant_force")
    effects = [bench.effect("viscous_friction"), load]
    chosen = select(bench.shooting, effects, bench.nominal, [((load,), (np.array([0.01]),))])
    assert chosen.best.keys == {("viscous_friction", "joint:hip")}
    assert frozenset({load.key}) in {fit.keys for fit in chosen.fits}


def _softly_rubbed(bench, level: float, steps: int = 20, rows: int = 201) -> Recording:
    """A slow run at 100 Hz that MuJoCo integrates in steps of 0.5 ms, with its default softness of dry friction."""
    xml = bench.xml.replace('name="hip"', f'name="hip" frictionloss="{level}"').replace('"0.005"', '"0.0005"')
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    time = np.arange(rows) * steps * model.opt.timestep
    control = 0.6 * np.sin(2 * np.pi * 0.5 * time) + 0.3 * np.sin(2 * np.pi * 1.1 * time)
    angles = []
    for u in control:
        angles.append(data.qpos[0])
        data.ctrl[0] = u
        mujoco.mj_step(model, data, steps)
    noise = FINE * np.random.default_rng(5).normal(size=rows)
    return Recording.from_columns("soft", {"time": time, "qpos.hip": np.array(angles) + noise, "ctrl.drive": control})


def test_friction_that_another_simulator_softens_is_fitted_in_its_own_form(bench) -> None:
    machine = make_machine(mujoco.MjModel.from_xml_string(bench.xml), [_softly_rubbed(bench, 0.3)], [])
    segments = cut(machine.fit, 0.5, 0.1)
    shooting = Shooting(bench.engine, segments, NoiseModel.white(np.array([FINE])))
    nominal = shooting.fit([((), ())], bench.engine.starts(segments))[0]
    dry = [effect for effect in bench.effects if effect.key == ("coulomb_friction", "joint:hip")]
    chosen = select(shooting, [*dry, bench.effect("viscous_friction")], nominal)
    assert chosen.best.keys == {dry[0].key}
    assert chosen.best.effects[0].variant == "soft"
    assert chosen.best.values[0][0] == pytest.approx(0.3, rel=0.02)
    firm = [
        fit for fit in chosen.fits if [effect.variant for effect in fit.effects] == [""] and fit.keys == {dry[0].key}
    ]
    assert min(fit.chi2 for fit in firm) > chosen.best.chi2 + 50
