"""What recordings do not hold: controls, and positions of joints."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.runs import Channels, input_addresses
from torch_activegp.physics.naming import joint_name


def undriven(model: mujoco.MjModel, recordings: Sequence[Recording]) -> list[str]:
    """A note on the recordings without any control, if there are some and the model has actuators."""
    names, inputs = [recording.label for recording in recordings if not recording.actuators], input_addresses(model)
    if not names or not inputs:
        return []
    missing = ", ".join(f"ctrl.{name}" for name in inputs)
    return [
        f"{_whose(names, recordings)}: no control is recorded ({missing}); taken as 0. If the machine was driven, "
        "nothing can explain its motion so: record them."
    ]


def partly_driven(model: mujoco.MjModel, recordings: Sequence[Recording]) -> list[str]:
    """Notes on the recordings without some of the model's controls, one for those that lack the same."""
    lacking: dict[tuple[str, ...], list[str]] = {}
    for recording in recordings:
        missing = tuple(f"ctrl.{name}" for name in input_addresses(model) if name not in recording.actuators)
        if missing and recording.actuators:
            lacking.setdefault(missing, []).append(recording.label)
    return [
        f"{_whose(names, recordings)}: no {', '.join(missing)}; taken as 0. If such a drive moved it, nothing can "
        f"explain its motion so: record {'it' if len(missing) == 1 else 'them'}."
        for missing, names in lacking.items()
    ]


def _whose(names: Sequence[str], recordings: Sequence[Recording]) -> str:
    return ", ".join(names) if len(names) < len(recordings) or len(names) == 1 else "all recordings"


def unrecorded(model: mujoco.MjModel, channels: Channels) -> list[str]:
    """The hinges and slides whose positions not all recordings hold."""
    known = {*channels.joints, *(channels.prescribed.joints if channels.prescribed is not None else ())}
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joints = [joint_name(model, i) for i in range(model.njnt) if model.jnt_type[i] in kinds]
    return [joint for joint in joints if joint not in known]


def unseen(model: mujoco.MjModel, channels: Channels) -> list[str]:
    """A note on the joints whose positions not all recordings hold."""
    missing = ", ".join(f"qpos.{joint}" for joint in unrecorded(model, channels))
    what = "simulated, but compared with nothing: what acts on these joints is seen through the others alone"
    return [f"Not in all recordings: {missing}; {what}. Record them if you can."] if missing else []
