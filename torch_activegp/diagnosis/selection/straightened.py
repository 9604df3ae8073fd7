"""Springs in place of a wave that the recordings see less than one period of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.proposals import Set, paired
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.cogging import Cogging
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.springs import Spring

_AT_ITS_LEAST = 1.05
"""Times the least number of periods that a cogging may have, up to which it is at its bound."""
_POSITIONS = 41


def straightened(best: Fit, effects: Sequence[Effect]) -> list[Set]:
    """A set with each spring that could stand in place of a cogging whose number of periods is at its bound.

    So slow a wave is what a spring does, bent by what else is missing. On an arm whose harness pulled like a spring,
    and which stuck so often that a search ended before it tried others in place of its names, a cogging of 0.8 periods
    over the range left 1.60 times the noise, and a spring with a rest 1.34.

    Args:
        best: the set.
        effects: what is tried.
    """
    sets = list[Set]()
    for wave, values in best.by_effect.items():
        if not isinstance(wave, Cogging) or wave.linear > 2:
            continue
        if values[wave.linear] > _AT_ITS_LEAST * wave.parameters[wave.linear].low:
            continue
        positions = np.linspace(*wave.range, _POSITIONS)
        speeds = np.zeros(_POSITIONS)
        pull = wave.force(positions, speeds, values)
        for spring in effects:
            if isinstance(spring, Spring) and spring.target == wave.target and spring.key not in best.keys:
                laws = [spring.force(positions, speeds, amplitudes) for amplitudes in np.eye(spring.linear)]
                alike: Array = np.linalg.lstsq(np.stack(laws, axis=1), pull, rcond=None)[0].astype(float)
                instead: dict[Effect, tuple[Effect, Array]] = {wave: (spring, alike)}
                sets.append(paired([instead.get(e, (e, v)) for e, v in best.by_effect.items()]))
    return sets
