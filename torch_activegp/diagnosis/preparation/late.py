"""Sets of effects whose control or recording comes late, which is what a wrong time step looks like."""

from __future__ import annotations

from collections.abc import Sequence

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.physics.effect import Effect

LIKE_A_TIME_STEP = frozenset({"actuator_delay", "actuator_lag", "sensor_delay"})

Sets = Sequence[tuple[Sequence[Effect], Sequence[Array]]]


def without_delays(sets: Sets) -> list[tuple[tuple[Effect, ...], tuple[Array, ...]]]:
    """The same sets without what a wrong time step looks like."""
    out = []
    for effects, values in sets:
        kept = [(e, v) for e, v in zip(effects, values, strict=True) if e.name not in LIKE_A_TIME_STEP]
        if len(kept) < len(effects):
            out.append((tuple(e for e, _ in kept), tuple(v for _, v in kept)))
    return out


def otherwise_late(sets: Sets) -> list[tuple[tuple[Effect, ...], tuple[Array, ...]]]:
    """Those of some sets that differ from the first one only in how or where something comes late."""

    def rest(effects: Sequence[Effect]) -> frozenset[Effect]:
        return frozenset(effect for effect in effects if effect.name not in LIKE_A_TIME_STEP)

    first = sets[0][0] if sets else ()
    if len(rest(first)) == len(first):
        return []
    return [(tuple(e), tuple(v)) for e, v in sets[1:] if rest(e) == rest(first) and len(e) > len(rest(e))]
