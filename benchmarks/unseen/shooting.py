"""Multiple shooting with our own model: how badly the nominal fits, and what a lab's least squares makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.unseen.machine import Machine
from benchmarks.unseen.simulate import Path, simulate

Array = np.ndarray


@dataclass
class Segments:
    """Pieces of one second: times and controls (S, K, .), what to fit, and where to start."""

    time: Array
    control: Array
    data: Array
    q: Array
    v: Array

    @classmethod
    def of(cls, machine: Machine, path: Path, data: Array, most: int, rng: np.random.Generator) -> Segments:
        """At most so many, chosen at random."""
        K = round(1.0 / machine.dt) + 1
        places = [(b, k) for b in range(len(path.time)) for k in range(0, path.time.shape[1] - K + 1, K - 1)]
        if len(places) > most:
            places = [places[i] for i in sorted(rng.choice(len(places), most, replace=False))]
        cut = [(b, slice(k, k + K)) for b, k in places]
        return cls(
            np.stack([path.time[b, s] - path.time[b, s.start] for b, s in cut]),
            np.stack([path.control[b, s] for b, s in cut]),
            np.stack([data[b, s] for b, s in cut]),
            np.stack([path.q[b, s.start] for b, s in cut]),
            np.stack([path.v[b, s.start] for b, s in cut]),
        )


def _roll(machine: Machine, s: Segments, state: Array, values: dict[str, Array]) -> Array:
    """Positions for a batch of variations (V, S, 2n) of the initial states; tuned values (V,)."""
    V, S, n2 = state.shape
    times, controls = np.tile(s.time, (V, 1, 1))[:, :].reshape(V * S, -1), np.tile(s.control, (V, 1, 1, 1))
    controls = controls.reshape(V * S, *s.control.shape[1:])
    plant = machine.plant({k: np.repeat(v, S) for k, v in values.items()})
    flat = state.reshape(V * S, n2)
    path = simulate(plant, times, (flat[:, : n2 // 2], flat[:, n2 // 2 :]), lambda k, _: controls[:, k], machine.step)
    return path.q.reshape(V, S, *path.q.shape[1:])


@dataclass
class Fit:
    """Chi2 per degree of freedom of what was fitted, and the tuned values."""

    chi2: float
    values: dict[str, float]


def fit(machine: Machine, s: Segments, values: dict[str, float], tune: tuple[str, ...] = (), rounds: int = 2) -> Fit:
    """Least squares over the initial states of all segments, and over what is tuned (with a weak prior)."""
    sigma = np.array([noise.std for noise in machine.noise])
    rough = any(j.frictionloss for j in machine.joints)
    S, n = s.q.shape
    state = np.concatenate([s.q, s.v], 1)
    nudge = np.concatenate([sigma, sigma * 20]) * (2.0 if rough else 0.5)
    bump = 2e-2 if rough else 1e-3
    span = {k: max(abs(values[k]), 0.05 * _typical(machine, k)) for k in tune}
    P = len(tune)
    best, best_state, best_values = np.inf, state.copy(), dict(values)
    best_each = np.full(S, np.inf)
    dof = s.data.size - S * 2 * n - P
    shrink = 1.0
    step_state, step_values = np.zeros_like(state), np.zeros(P)
    for turn in range(rounds + 1):
        V = 1 if turn == rounds else 1 + 2 * n + P
        varied, tuned = _varied(state, values, nudge, {k: bump * x for k, x in span.items()}, V)
        paths = (_roll(machine, s, varied, tuned) - s.data) / sigma
        r = paths[0].reshape(S, -1)
        each = (r**2).sum(1)
        total = float(each.sum())
        if not tune:
            better = each < best_each
            best_each, best_state = np.where(better, each, best_each), np.where(better[:, None], state, best_state)
            best = float(best_each.sum())
        elif total < best:
            best, best_state, best_values = total, state.copy(), dict(values)
        else:
            shrink *= 0.4
        if V == 1:
            break
        if tune and total > best:
            state, values = best_state + shrink * step_state, _moved(best_values, tune, span, shrink * step_values)
            continue
        J = (paths[1:] - paths[0]).reshape(V - 1, S, -1).transpose(1, 2, 0)
        J[:, :, : 2 * n] /= nudge
        J[:, :, 2 * n :] /= bump
        step_state, step_values = _solve(J, r, n, P)
        state, values = state + step_state, _moved(values, tune, span, step_values)
    return Fit(best / dof, best_values)


def _varied(state: Array, values: dict[str, float], nudge: Array, bumps: dict[str, float],
            V: int) -> tuple[Array, dict[str, Array]]:  # fmt: skip
    """The states and values themselves, and each nudged in turn."""
    varied = np.tile(state, (V, 1, 1))
    tuned = {k: np.full(V, v) for k, v in values.items()}
    if V > 1:
        for i, by in enumerate(nudge):
            varied[1 + i, :, i] += by
        for i, k in enumerate(bumps):
            tuned[k][1 + len(nudge) + i] += bumps[k]
    return varied, tuned


def _moved(values: dict[str, float], tune: tuple[str, ...], span: dict[str, float], step: Array) -> dict[str, float]:
    out = dict(values)
    for k, d in zip(tune, np.clip(step, -0.6, 0.6), strict=True):
        moved = out[k] + d * span[k]
        out[k] = moved if k.startswith("bias") else max(moved, 0.02 * span[k])
    return out


def _solve(J: Array, r: Array, n: int, P: int) -> tuple[Array, Array]:
    """Gauss-Newton with the initial states eliminated segment by segment."""
    scale = np.linalg.norm(J[:, :, : 2 * n], axis=1) + 1e-12
    Js = J[:, :, : 2 * n] / scale[:, None, :]
    Q, R = np.linalg.qr(Js)
    steps = np.zeros(P)
    if P:
        Jp = J[:, :, 2 * n :]
        Jp = Jp - Q @ (Q.swapaxes(1, 2) @ Jp)
        rp = r - (Q @ (Q.swapaxes(1, 2) @ r[..., None]))[..., 0]
        H = np.einsum("skp,skq->pq", Jp, Jp) + 4.0 * np.eye(P)
        steps = -np.linalg.solve(H, np.einsum("skp,sk->p", Jp, rp))
    rest = r + J[:, :, 2 * n :] @ steps
    A = R + 1e-9 * np.eye(2 * n)
    state = -np.linalg.solve(A, (Q.swapaxes(1, 2) @ rest[..., None]))[..., 0]
    return state / scale, steps


def _typical(machine: Machine, key: str) -> float:
    """A natural size for a bias that is zero on paper."""
    kind, _, name = key.partition("_")
    if kind != "bias":
        return 0.0 if kind != "armature" else 1e-3
    motor = machine.motors[machine.motor(name)]
    return abs(motor.gain * motor.gear)
