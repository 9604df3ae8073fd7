from __future__ import annotations

import pytest

from torch_activegp.diagnosis.selection.omnibus import omnibus


def test_a_free_force_explains_what_is_missing_and_no_noise(bench, clean) -> None:
    missing, noise = omnibus(bench.shooting, bench.nominal), omnibus(clean.shooting, clean.nominal)
    assert missing.p_value < 1e-12
    assert missing.excess == pytest.approx(bench.nominal.chi2 - bench.shooting.dof, rel=0.15)
    assert noise.p_value > 0.001
    assert noise.excess < 40
    fitted = omnibus(bench.shooting, bench.fit("viscous_friction", 0.05))
    assert fitted.p_value > 0.001
