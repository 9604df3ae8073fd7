from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.polish import polish
from torch_activegp.diagnosis.shooting.advance import advance
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine


@pytest.fixture
def asked(monkeypatch) -> list[tuple[int, int, int]]:
    """Substeps, segments and candidates of every simulation."""
    seen: list[tuple[int, int, int]] = []
    predict = Engine.predict

    def listen(self, segments, starts, candidates):
        seen.append((self.substeps, segments.size, len(candidates)))
        return predict(self, segments, starts, candidates)

    monkeypatch.setattr(Engine, "predict", listen)
    return seen


@pytest.mark.parametrize(("wanted", "sizes"), [(1, [1, 8]), (4, [4, 8]), (5, [8]), (8, [8])])
def test_what_wants_most_segments_is_simulated_with_the_others(bench, asked, wanted, sizes) -> None:
    all_of_them = _Wants(bench, None)
    some = _Wants(bench, np.arange(bench.segments.size) < wanted)
    advance(bench.shooting, [all_of_them, some], last=False)
    assert [size for _, size, _ in asked] == sizes
    np.testing.assert_array_equal(some.told[0, :wanted], all_of_them.told[0, :wanted])


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("lent", [False, True])
def test_what_is_moved_is_simulated_cheaply_where_a_fit_takes_that(fast, bench, asked, known, lent) -> None:
    plain, wants = _Wants(bench, None, count=3), _Wants(bench, None, count=3, lent=lent)
    residual = bench.shooting.residual_of(bench.nominal)
    wants.known = residual if known else None
    advance(bench.shooting, [plain], last=False)
    asked.clear()
    advance(fast, [wants], last=False)
    cheap = [] if not lent else [(1, 8, 3)]
    precise = [(2, 8, (not known) + (0 if lent else 2))] * (not (known and lent))
    assert asked == precise + cheap
    np.testing.assert_allclose(wants.told[0], residual, atol=1e-6)
    steps, exact = wants.told[1:] - wants.told[0], plain.told[1:] - plain.told[0]
    assert np.abs(exact).max() > 1.0
    np.testing.assert_allclose(steps, exact, atol=0.1 * np.abs(exact).max())
    assert bool(np.abs(steps - exact).max() > 1e-6) is lent


def test_where_the_cheap_simulation_fails_the_precise_one_lends(fast, bench, asked, monkeypatch) -> None:
    residuals = Shooting.residuals
    monkeypatch.setattr(
        Shooting,
        "residuals",
        lambda self, predicted: residuals(self, predicted) * (np.nan if self.cheap is self.engine else 1),
    )
    wants = _Wants(bench, None, count=3, lent=True)
    advance(fast, [wants], last=False)
    assert wants.lent is False
    assert [(steps, count) for steps, _, count in asked] == [(2, 1), (1, 3), (2, 2)]
    assert np.isfinite(wants.told).all()


def test_derivatives_by_a_cheap_engine_lead_to_the_same_optimum(fast, bench) -> None:
    """By half of the time steps of the truth, with an integrator of first order."""
    alone, lent = bench.fit("viscous_friction", 0.3), fast.fit(_viscous(bench), bench.nominal.starts)[0]
    assert fast.lends
    assert lent.chi2 == pytest.approx(alone.chi2, abs=0.5)
    np.testing.assert_allclose(lent.values[0], alone.values[0], rtol=2e-3)
    assert not np.array_equal(lent.columns, alone.columns)


def test_far_from_the_noise_a_fit_does_not_end_on_derivatives_that_were_lent(fast, bench) -> None:
    """A rotor for a friction: where the cheap derivatives promise nothing more, the precise ones still do."""
    rotor = [((bench.effect("armature_error"),), (np.array([0.001]),))]
    alone, lent = (shooting.fit(rotor, bench.nominal.starts)[0] for shooting in (bench.shooting, fast))
    assert alone.chi2 > 2 * bench.shooting.dof
    assert lent.chi2 == pytest.approx(alone.chi2, abs=0.1)


def test_states_alone_end_about_where_precise_derivatives_lead(fast, bench) -> None:
    friction, starts = (bench.effect("coulomb_friction"),), bench.nominal.starts.copy()
    starts[2] += np.array([0.05, 1.0])
    held = [(friction, (np.array([0.2]),))]
    alone, lent = (shooting.fit(held, starts, hold=True)[0] for shooting in (bench.shooting, fast))
    assert alone.chi2 > 2 * bench.shooting.dof
    assert lent.chi2 == pytest.approx(alone.chi2, rel=1e-3)


def test_the_last_fit_has_its_own_derivatives(fast, bench) -> None:
    friction = bench.effect("viscous_friction")
    found = fast.fit(_viscous(bench), bench.nominal.starts)[0]
    chosen = Selection(bench.nominal, [bench.nominal, found], Score(bench.shooting.samples, 5, 1.0))
    polish(fast, chosen, [friction])
    alone = bench.shooting.fit([(found.effects, found.values)], found.starts)[0]
    np.testing.assert_allclose(chosen.best.information, alone.information, rtol=1e-5)
    assert abs(found.information[0, 0] / alone.information[0, 0] - 1.0) > 5e-4


def test_work_is_counted_once(bench) -> None:
    shooting = dataclasses.replace(bench.shooting, cheap=bench.engine)
    before = bench.engine.work, shooting.work
    shooting.predicted(bench.nominal)
    assert shooting.work - before[1] == bench.engine.work - before[0] > 0.0


@pytest.mark.parametrize(("times", "lends"), [(7.0, True), (9.0, False)])
def test_a_cheap_engine_that_saves_little_lends_nothing(fast, monkeypatch, times, lends) -> None:
    """The precise one takes eight times its steps here."""
    monkeypatch.setattr("torch_activegp.diagnosis.shooting.likelihood.LENDS", times)
    assert fast.lends is lends


def test_derivatives_that_mislead_are_taken_anew_by_the_precise_engine(bench, asked) -> None:
    """Where gravity points upwards."""
    model = mujoco.MjModel.from_xml_string(bench.xml)
    model.opt.gravity[2] *= -3.0
    wrong = Engine(model, bench.machine.channels, 1, 1, int(mujoco.mjtIntegrator.mjINT_EULER))
    shooting = dataclasses.replace(bench.shooting, cheap=wrong)
    fit = shooting.fit(_viscous(bench), bench.nominal.starts)[0]
    assert any(substeps == 2 and count > 1 for substeps, _, count in asked)
    assert fit.chi2 == pytest.approx(bench.fit("viscous_friction", 0.3).chi2, abs=1.0)


@pytest.fixture
def fast(bench) -> Shooting:
    """The same likelihood with derivatives from semi-implicit Euler in twice the time step."""
    euler = Engine(bench.machine.model, bench.machine.channels, 1, 1, int(mujoco.mjtIntegrator.mjINT_EULER))
    return dataclasses.replace(bench.shooting, cheap=euler)


def _viscous(bench) -> list:
    return [((bench.effect("viscous_friction"),), (np.array([0.3]),))]


class _Wants:
    """Asks for the nominal in some segments, and with its states moved."""

    def __init__(self, bench, only, count: int = 1, lent: bool = False) -> None:
        self.only, self.lent, self.known = only, lent, None
        self.states = np.repeat(bench.nominal.starts[None], count, axis=0)
        self.states += 1e-2 * np.arange(count)[:, None, None]
        self.others = np.zeros(bench.nominal.design.shape[:2])

    def ask(self):
        return [NOMINAL] * len(self.states), self.states

    def tell(self, white, last) -> None:
        self.told = white
