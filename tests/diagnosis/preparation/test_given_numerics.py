"""Numerics of a black box: semi-implicit Euler is seen by its controls, which seem to come half a step late."""

from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.given_numerics import GivenNumerics
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.simulators import rk4, semi_implicit_euler

_NOISE = NoiseModel.white(np.array([1e-3]))


def test_there_are_two_forms_to_choose(black) -> None:
    for name, integrator in (("given", rk4), ("fine", semi_implicit_euler)):
        simulator, recordings = black.simulator(), [black.record("none", 0)]
        simulator.integrator = integrator
        box = BlackBox.of(simulator)
        numerics = GivenNumerics.of(machine := make_machine(box.model, recordings, recordings, box))
        assert (numerics.given.late, numerics.fine.late, numerics.coarse) == (False, True, numerics.given)
        segments = cut(machine.fit, 0.5, 0.1)
        first = Shooting(numerics.given, segments, _NOISE).fit([((), ())], numerics.given.starts(segments))[0]
        engine, _, nominal, _ = numerics.choose(segments, _NOISE, first, first)
        assert engine is getattr(numerics, name)
        assert nominal.chi2 < 1.3 * segments.counts.sum()
