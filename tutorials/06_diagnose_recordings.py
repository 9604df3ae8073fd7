"""
What does my simulator leave out?
=================================

You have an MJCF model of a machine and recordings of the machine itself, and they do not quite agree. ``diagnose`` says
whether that is more than noise, which physics is missing, where, and how much of it, and writes the corrected model.
"""

# %%
# Recordings
# ----------
# A recording is a table: ``time``, positions ``qpos.<joint>``, controls ``ctrl.<actuator>``, SI units. Velocities are
# not needed. Row k holds the position at its time and the control from then until the next row.
#
# Ours come from a pendulum with a little dry friction, integrated by code that the diagnosis does not use; the model
# has the right mass and damping, and no dry friction. Yours come from a logger: start at ``load_recordings``.

import json
import tempfile
from pathlib import Path

import mujoco
import numpy as np
import torch

from torch_activegp.data import load_recordings
from torch_activegp.diagnosis import diagnose
from torch_activegp.experiments.demo import MODEL, NOISE, Secret, record
from torch_activegp.report import write_report

folder = Path(tempfile.mkdtemp())
(folder / "model.xml").write_text(MODEL)
truth = Secret("coulomb_friction", "joint:pivot", "level", 0.03, "N m")
rng = np.random.default_rng(0)
for name in ("run1", "run2", "run3", "test1"):
    record(truth, rng).to_csv(folder / f"{name}.csv", index=False)
runs, held_out = load_recordings(str(folder / "run*.csv")), load_recordings(str(folder / "test*.csv"))
print(runs[0])

# %%
# The diagnosis
# -------------
# It never sees ``truth``. The sentence comes first; the verdict behind it is ``named``, ``tie`` (named, but these
# recordings cannot tell it from something else), ``unknown`` (something is missing, and nothing on the list explains
# it) or ``none`` (noise alone).

diagnosis = diagnose(folder / "model.xml", runs, held_out)
print(diagnosis)

# %%
# How much, and how sure
# ----------------------
# Each effect has its part of the mismatch, its probability among the sets that were compared, and its parameters with
# 95 % intervals. ``diagnosis.to_dict()`` holds all that was found; here the errors on the run that was held out, in
# standard deviations of what was measured: before, after, and what noise alone would leave.

(effect,) = diagnosis.effects
level = effect.parameters["level"]
print(f"{effect.name} ({effect.law}) at {effect.target}: {level}, true {truth.value} {truth.unit}")
print(f"explains {effect.share:.1%}, probability {effect.probability:.3f}")
found = diagnosis.to_dict()
free_run = found["fit"]["holdout"]["free_run"]
print("free run: " + ", ".join(f"{name} {error:.4f}" for name, error in free_run.items()))
noise = found["mismatch"]["noise"]["qpos.pivot"]
print(f"noise of the encoder: {noise:.2g} rad, true {NOISE:.2g}")

# %%
# The corrected model
# -------------------
# MJCF can hold this effect, so ``corrected.xml`` is your model with one more attribute, in the words in which MuJoCo
# writes models; ``report.html`` holds the difference, to copy into your own file. It also shows the
# evidence; it is one file that needs no network. ``next.csv`` holds controls under which the best two explanations
# would differ most. ``diagnosis.corrected`` is the same as a simulator: step it, plan with it, make it a GP's mean.

diagnosis.save(folder / "out")
write_report(found, diagnosis.evidence, folder / "out" / "report.html")
print(sorted(path.name for path in (folder / "out").iterdir()))
corrected = mujoco.MjModel.from_xml_path(str(folder / "out" / "corrected.xml"))
print(f"frictionloss: {corrected.dof_frictionloss[0]:.4f} N m")
swing = diagnosis.corrected.rollout(torch.tensor([0.01, 0.0]), torch.zeros(200, 1))
print(f"let go at 0.0100 rad, friction holds it: {swing[-1, 0]:.4f} rad after a second")

# %%
# A simulator that is right
# -------------------------
# A tool that always finds something is of no use. Recordings of the model's own equation give another verdict.

for name in ("fine1", "fine2", "fine3"):
    record(Secret("none"), rng).to_csv(folder / f"{name}.csv", index=False)
fine = diagnose(folder / "model.xml", load_recordings(str(folder / "fine*.csv")))
print(fine)

# %%
# What we claimed
# ---------------

assert (effect.name, effect.target) == (truth.name, truth.target)
assert effect.mjcf
assert abs(level.value - truth.value) < 0.1 * truth.value
assert abs(noise / NOISE - 1) < 0.15
assert free_run["after"] < 0.2 * free_run["before"]
assert abs(corrected.dof_frictionloss[0] - level.value) < 1e-6
assert abs(swing[-1, 0] - 0.01) < 1e-3
assert json.loads((folder / "out" / "diagnosis.json").read_text())["verdict"] == diagnosis.verdict
assert fine.verdict == "none"
