from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import aliases as module
from torch_activegp.diagnosis.selection import search
from torch_activegp.diagnosis.selection.aliases import aliases, try_aliases
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.search import Depth, select
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.score import Score

BIAS = ("actuator_bias", "actuator:drive")


@pytest.fixture(scope="module")
def pushed(bench) -> Fit:
    """The friction that is there, and a constant push that is not."""
    friction, push = bench.effect("viscous_friction"), bench.effect("constant_force")
    fit = bench.shooting.fit([((friction, push), (np.array([0.06]), np.array([0.0])))], bench.nominal.starts)[0]
    return dataclasses.replace(fit, values=(fit.values[0], np.array([0.02])))


def test_a_drives_bias_is_an_alias_of_a_push_and_a_friction_is_none(bench, pushed) -> None:
    found = aliases(bench.shooting, pushed, bench.effect("constant_force"), bench.effects)
    keys = [atom.effect.key for atom in found]
    assert BIAS in keys
    others = {"viscous_friction", "coulomb_friction", "cubic_spring", "sensor_delay"}
    less = {"joint_stop", "cogging", "payload_mass", "actuator_gain", "quadratic_drag"}  # of what it does
    assert not (others | less) & {name for name, _ in keys}
    assert ("linear_spring", "joint:hip") not in keys  # which would want a stiffness of less than none
    assert found[keys.index(BIAS)].values[0] == pytest.approx(0.02, rel=1e-3)
    assert all(atom.gain <= found[0].gain for atom in found)
    assert ("constant_force", "joint:hip") not in keys


def test_what_loses_no_more_than_a_tie_is_an_alias_too_but_not_what_does_less_than_half(bench, pushed) -> None:
    push, partly = bench.effect("constant_force"), ("asymmetric_friction", "joint:hip")

    def found(slack: float) -> dict[tuple[str, str], float]:
        return {atom.effect.key: atom.gain for atom in aliases(bench.shooting, pushed, push, bench.effects, slack)}

    all_of_it, whole = found(1e9), max(found(0.0).values())
    part, _ = bench.shooting.subset(0.2)
    lost = (whole - all_of_it[partly]) * bench.shooting.dof / part.dof
    assert lost > 1.0
    assert partly not in found(0.8 * lost)
    assert partly in found(1.2 * lost)
    assert min(all_of_it.values()) > 0.5 * whole
    assert ("joint_stop", "joint:hip") not in all_of_it


def test_what_is_absent_has_no_alias(bench, pushed) -> None:
    nothing = dataclasses.replace(pushed, values=(pushed.values[0], np.zeros(1)))
    assert aliases(bench.shooting, nothing, bench.effect("constant_force"), bench.effects) == []


def test_aliases_are_fitted_where_noise_alone_is_left(bench, pushed) -> None:
    friction = bench.fit("viscous_friction", bench.viscous)
    for left, tried in ((1.0, True), (1.5, False)):
        best = dataclasses.replace(pushed, chi2=min(friction.chi2, pushed.chi2) - 100.0)
        if left > 1.0:
            best = dataclasses.replace(best, chi2=left * bench.shooting.dof)
        selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.0))
        assert selection.best is best
        try_aliases(selection, bench.shooting, bench.effects)
        others = [fit for fit in selection.fits if BIAS in fit.keys]
        assert bool(others) == tried
        if tried:
            whole = bench.shooting.fit([(pushed.effects, pushed.values)], bench.nominal.starts)[0]
            assert min(fit.chi2 for fit in others) == pytest.approx(whole.chi2, abs=0.1)


def test_a_search_asks_for_those_that_lose_no_more_than_a_tie(bench, pushed, monkeypatch) -> None:
    asked: list[float] = []
    monkeypatch.setattr(module, "aliases", lambda *given: asked.append(given[-1]) or [])
    best = dataclasses.replace(pushed, chi2=bench.shooting.dof)
    selection = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 60, 1.5))
    try_aliases(selection, bench.shooting, bench.effects)
    assert asked == [6.0 * 1.5] * 2


@pytest.mark.parametrize("work", [0.0, 1e9])
def test_they_are_looked_for_where_a_search_was_cut_short(bench, monkeypatch, work: float) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(search, "try_in_place", lambda selection, *_: asked.append(selection.cut_short))
    effects = [bench.effect("viscous_friction"), bench.effect("cubic_spring")]
    found = select(bench.shooting, effects, bench.nominal, depth=Depth(work=work))
    assert asked == ([True] if work == 0.0 else [])
    assert found.cut_short == (work == 0.0)


def test_an_amplitude_at_its_bound_is_no_alias(bench, pushed) -> None:
    found = aliases(bench.shooting, pushed, bench.effect("constant_force"), bench.effects)
    atom = next(atom for atom in found if atom.effect.key == BIAS)
    parameter = dataclasses.replace(atom.effect.parameters[0], high=float(atom.values[0]))
    bounded = dataclasses.replace(atom, effect=dataclasses.replace(atom.effect, parameters=(parameter,)))
    assert module._inside(atom)
    assert not module._inside(bounded)
