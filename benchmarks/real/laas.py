"""LAAS: friction from current reversals, cogging from slow turns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.real.regression import Signals, force, least_squares, rms, signals
from torch_activegp.data import load_laas
from torch_activegp.physics.cogging import ENDINGS

INERTIA, CUTOFF = 1.95e-4, 150.0
FASTEST = 160
"""A s2/rad; Hz, above the 72 periods at the fastest 10 rad/s; most periods a turn that are tried."""


def _signals(name: str, cutoff: float) -> Signals:
    return signals([run for run in load_laas(name) if len(run) > 400], "rotor", "current", cutoff)


def _terms(seen: Signals, periods: Sequence[int]) -> list[np.ndarray]:
    losses = [seen.acceleration, seen.velocity, np.sign(seen.velocity), np.ones_like(seen.velocity)]
    return losses + [wave(n * seen.position) for n in periods for wave in (np.cos, np.sin)]


def strongest(seen: Signals, known: Sequence[int], left: np.ndarray) -> int:
    """The periods a turn that explain most of what is left, next to those that are known."""
    basis = np.linalg.qr(np.stack(_terms(seen, known), axis=1))[0]
    gains = np.zeros(FASTEST + 1)
    for n in set(range(1, FASTEST + 1)) - set(known):
        waves = np.stack([np.cos(n * seen.position), np.sin(n * seen.position)], axis=1)
        waves -= basis @ (basis.T @ waves)
        gains[n] = np.sum((waves @ np.linalg.lstsq(waves, left, rcond=None)[0]) ** 2)
    return int(np.argmax(gains))


def cogging(cutoff: float, count: int = 3) -> list[tuple[list[int], np.ndarray, float, float]]:
    """Periods, one more at a time: coefficients, and the relative residual on ``speed_test1`` and on ``speed_test``."""
    seen, other = _signals("speed_test1", cutoff), _signals("speed_test", cutoff)
    known: list[int] = []
    rows = []
    for _ in range(count + 1):
        found, left = least_squares(_terms(seen, known), seen.control)
        held_out = other.control - np.stack(_terms(other, known), axis=1) @ found
        rows.append((list(known), found, rms(left) / seen.control.std(), rms(held_out) / other.control.std()))
        known.append(strongest(seen, known, left))
    return rows


def reference() -> list[str]:
    """Markdown lines: what plain least squares finds."""
    lines = ["| LAAS, acc_current, low-pass | J / kt, A s2/rad | viscous, A s/rad | Coulomb, A | residual, A |"]
    lines.append("|---|---|---|---|---|")
    for cutoff in (10.0, 20.0, 50.0):
        seen = _signals("acc_current", cutoff)
        found, left = least_squares(_terms(seen, ()), seen.control)
        lines.append(f"| {cutoff:.0f} Hz | {found[0]:.3g} | {found[1]:.3g} | {found[2]:.4f} | {rms(left):.4f} |")
    lines += ["", "| LAAS, slow turns | periods | J / kt | amplitudes, A | speed_test1 | speed_test, held out |"]
    lines.append("|---|---|---|---|---|---|")
    for cutoff in (100.0, CUTOFF):
        for periods, found, left, held_out in cogging(cutoff):
            sizes = ", ".join(f"{size:.3f}" for size in np.hypot(found[4::2], found[5::2]))
            cells = f"{', '.join(map(str, periods))} | {found[0]:.3g} | {sizes} | {left:.3f} | {held_out:.3f}"
            lines.append(f"| {cutoff:.0f} Hz | {cells} |")
    return lines


def judge_friction(diagnosis: Mapping[str, Any]) -> list[tuple[str, str, bool]]:
    """What was asked of ``acc_current``, what was found, and whether that holds."""
    names = [effect["name"] for effect in diagnosis["effects"]]
    return [("friction from acc_current", ", ".join(names) or "none", "coulomb_friction" in names)]


def judge_cogging(diagnosis: Mapping[str, Any]) -> list[tuple[str, str, bool]]:
    """What was asked of the slow turns, what was found, and whether that holds."""
    effects = diagnosis["effects"]
    laws = [effect["parameters"] for effect in effects if effect["name"] == "cogging"]
    found = [law[f"periods{end}"]["value"] for law in laws for end in ENDINGS if f"periods{end}" in law]
    rows = [
        ("cogging of 72 periods first", f"{found[0]:.1f}" if found else "none", [round(n) for n in found[:1]] == [72]),
        (
            "then 18 and 12",
            ", ".join(f"{n:.1f}" for n in found[1:]) or "none",
            [round(n) for n in found[1:3]] == [18, 12],
        ),
    ]
    seen = _signals("speed_test", CUTOFF)
    try:
        law = force(effects, 1.0)(seen.position, seen.velocity)
    except KeyError as error:
        return [*rows, ("held-out residual at most 0.16", f"{error} is no force here", False)]
    residual = rms(seen.control + law - INERTIA * seen.acceleration) / seen.control.std()
    return [*rows, ("held-out residual at most 0.16", f"{residual:.3f}", residual <= 0.16)]
