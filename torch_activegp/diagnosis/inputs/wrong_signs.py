"""Controls and positions whose sign is the other way round, seen by the forces that the motion would take."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run, input_addresses
from torch_activegp.diagnosis.inputs.wrong_units import Motion, balance, forces_of
from torch_activegp.errors import DataError

_LACKS = 0.5
"""Forces that the model lacks on a joint, over those that it has, from which a sign is doubted."""
_BETTER = 5.0
"""So many times less must be lacking with the other sign. What else a model may lack does not do so: friction that
takes all that a drive gives, for instance, is lacking with either."""
_NO_WORSE = 1.1


def check_signs(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> None:
    """Refuses recordings that need forces which the model has with one control, or one position, negated.

    No gain on the list of effects is negative, so none undoes a flipped sign, and what comes closest would be named.

    Args:
        model: nominal.
        channels: the recorded joints.
        runs: for fitting.

    Raises:
        DataError: a sign seems to be the other way round.
    """
    balanced = balance(model, channels, runs)
    if balanced is None:
        return
    motion, missing, there = balanced.motion, balanced.missing, balanced.there
    lacking = float((missing / there).max())
    if lacking < _LACKS:
        return
    worst = int(np.argmax(missing / there))
    found = []
    for column, other, factors in _flipped(model, channels, motion):
        left, base = forces_of(model, channels, other, factors)
        if left[worst] * _BETTER < missing[worst] and (left <= _NO_WORSE * missing).all() and (base > 0.0).all():
            found.append((float(left[worst] / base[worst]), column))
    if found:
        after, column = min(found)
        raise DataError(
            f"Column `{column}`: the sign seems to be the other way round. What was recorded would take "
            f"{lacking:.2g} times the forces that the model has on joint {channels.joints[worst]}, on top of them; "
            f"with the other sign {after:.1g} times. If so, turn it in its line of a column map (--columns MAP.toml): "
            f'{column} = {{ column = "...", sign = -1 }}, or without that where it is there; or turn it in the model.'
        )


def _flipped(model: mujoco.MjModel, channels: Channels, motion: Motion) -> Iterator[tuple[str, Motion, Array]]:
    """Columns, the motion with each control negated, and factors of the positions."""
    same = np.ones(len(channels.joints))
    for name, index in input_addresses(model).items():
        control = motion.control.copy()
        control[:, index] *= -1.0
        yield f"ctrl.{name}", dataclasses.replace(motion, control=control), same
    for c, joint in enumerate(channels.joints):
        yield f"qpos.{joint}", motion, np.where(np.arange(len(same)) == c, -1.0, 1.0)
