from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.own_forms import likeliest, own_rivals
from torch_activegp.diagnosis.preparation.rivals import Rival
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.forms import Forms

NOISE = 1e-5


@pytest.fixture(scope="module")
def damped(clean):
    """Forms of a damped pendulum in steps of 10 ms, and a likelihood of what one of them made."""
    forms = Forms.of(clean.integrated("implicitfast", 0.01, 'damping="0.3"'), 1)
    segments = clean.segments

    def made_by(truth) -> tuple[Shooting, object]:
        told = truth.predict(segments, clean.nominal.starts[None], [NOMINAL])[0]
        noise = NOISE * np.random.default_rng(0).normal(size=told.shape)
        recorded = dataclasses.replace(segments, position=told + noise)
        shooting = Shooting(forms.fine, recorded, NoiseModel.white(np.array([NOISE])))
        return shooting, shooting.fit([((), ())], clean.nominal.starts)[0]

    return forms, made_by


@pytest.mark.parametrize("explicit", [True, False])
def test_the_scheme_and_step_that_recordings_were_made_with_come_closest(damped, explicit: bool) -> None:
    forms, made_by = damped
    truth = next(form for form in forms.own if form.explicit is explicit and form.substeps == 8)
    shooting, fit = made_by(truth)
    assert fit.chi2 > 2.0 * shooting.dof
    found = likeliest(forms, shooting, fit)
    assert found[0] is truth
    assert len({form.scheme for form in found}) == len(found)  # one of each scheme


def test_none_is_asked_where_another_is_closer_by_far(damped) -> None:
    forms, made_by = damped
    shooting, fit = made_by(forms.fine)
    rivals = [Rival.at(shooting, forms.fine, fit)]
    assert own_rivals(forms, forms.own, shooting, fit, [dataclasses.replace(rivals[0], left=1.0)]) == []
