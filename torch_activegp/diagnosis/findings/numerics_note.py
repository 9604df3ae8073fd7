"""In which numerics a model was fitted, and what its own do to its forecasts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco

from torch_activegp.diagnosis.findings.forecast import FAILED, compare
from torch_activegp.diagnosis.findings.unseen import foreseeable
from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Run, median_step
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.simulation.blackbox_engine import BlackBoxEngine
from torch_activegp.diagnosis.simulation.candidate import NOMINAL

_SCHEMES = {
    int(mujoco.mjtIntegrator.mjINT_EULER): "semi-implicit Euler",
    int(mujoco.mjtIntegrator.mjINT_RK4): "Runge-Kutta",
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): "implicit Euler",
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): "implicit Euler (implicitfast)",
}
_SLOWER = 1.5
"""Times as long from which on it is said."""
_AS_WELL = 1.05
"""Times an error up to which another one is called as small."""
_KINDS = {"one_step": "one step ahead", "free_run": "in free runs"}


def numerics_notes(explanation: Explanation, machine: Machine, chosen: Fit, holdout: Mapping[str, Any]) -> list[str]:
    """Where the model was not integrated as it says: how, and how well it forecasts held-out runs as it says.

    Args:
        explanation: what was found, and how.
        machine: model and runs.
        chosen: the set that the correction holds.
        holdout: the errors on held-out runs, in the numerics that were chosen.
    """
    if not explanation.fine:
        return []
    engine, what = explanation.engine, "The effects were fitted with" if chosen.effects else "The model was"
    if isinstance(engine, BlackBoxEngine):
        what = f"{what} the controls of {engine.box.name}" if chosen.effects else f"{engine.box.name} had its controls"
        return [
            f"{what} half a time step later, as they should come where it integrates by semi-implicit Euler: the "
            "recordings agree with that as well or better. That difference is discretisation and is not named. "
            "Forecasts and the corrected simulator keep the controls as they are."
        ]
    model = machine.model
    firmly = " and with dry friction in its joints that sticks firmly, where MuJoCo lets it creep" * explanation.firm
    return [
        f"{what}{' the model' * bool(chosen.effects)} integrated {_how(explanation)}{firmly}: the recordings agree "
        f"with that as well as with the model as it stands (by {_SCHEMES[int(model.opt.integrator)]} in steps of "
        f"{model.opt.timestep:g} s), or better. That difference is one of numerics and is not named. corrected.xml has "
        f"these steps{_slower(explanation, model)}. {_in_own_steps(explanation, chosen, machine.holdout, holdout)}"
    ]


def _in_own_steps(explanation: Explanation, chosen: Fit, runs: Sequence[Run], holdout: Mapping[str, Any]) -> str:
    """How well the corrected model forecasts in the model's own steps, in a sentence.

    The model without effects is simulated beside it, as for the other errors, for the two lend each other initial
    states.
    """
    given, noise, key = explanation.given, explanation.shooting.noise, "after"
    models = {"before": (given, NOMINAL), key: (given, chosen.candidate if chosen.effects else NOMINAL)}
    own, _ = compare(models, runs, given.channels.joints, noise)
    steady = len(foreseeable(holdout)) == len(holdout["runs"])
    kinds = [kind for kind in _KINDS if steady or kind == "one_step"]
    if any(entry[kind][key] >= FAILED for entry in own["runs"] for kind in kinds):
        return "In the model's own steps the simulation of held-out runs fails."
    if all(own[kind][key] <= _AS_WELL * holdout[kind][key] for kind in kinds):
        return "In the model's own steps held-out runs are forecast no worse."
    said = (f"{own[kind][key]:.3g} {_KINDS[kind]} (for {holdout[kind][key]:.3g} in these)" for kind in kinds)
    return (
        f"In the model's own steps the errors on held-out runs, in standard deviations of what was measured, are "
        f"{' and '.join(said)}; noise is {holdout['one_step']['noise']:.2g}."
    )


def _slower(explanation: Explanation, model: mujoco.MjModel) -> str:
    """How many times as long a simulation takes so; nothing where that is little."""
    own, engine = int(model.opt.integrator), explanation.engine.without_leapfrog()
    evaluations = {int(mujoco.mjtIntegrator.mjINT_RK4): 4.0}
    here, before = (evaluations.get(which, 1.0) for which in (int(engine.model.opt.integrator), own))
    ratio = here / _step(explanation) / (before / model.opt.timestep)
    return "" if ratio < _SLOWER else f" and takes {ratio:.2g} times as long to simulate"


def _step(explanation: Explanation) -> float:
    """The time step that goes into the corrected model, s."""
    return median_step(explanation.shooting.segments.runs) / explanation.engine.without_leapfrog().substeps


def _how(explanation: Explanation) -> str:
    """Integrator and time step, as they go into the corrected model."""
    engine, step = explanation.engine.without_leapfrog(), _step(explanation)
    explicitly = ", damping taken explicitly," * engine.explicit
    return f"by {_SCHEMES[int(engine.model.opt.integrator)]}{explicitly} in steps of {step:.3g} s"
