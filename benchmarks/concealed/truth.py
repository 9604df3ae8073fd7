"""The truth in time: explicit midpoint steps of 0.1 ms, dry friction and play by impulses that stick exactly.

Nothing of MuJoCo's or of the package's numerics is used. Each step predicts the middle, takes all smooth forces there,
and then finds the impulses of dry friction (within their bounds, none that leaves power) and of a closed play by
projected Gauss-Seidel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.concealed.dynamics import Work, compiled, inlined, invert, mass_and_bias, room
from benchmarks.concealed.plant import A, J, Plant, S

FINE = 1e-4
"""Step of the truth, s."""


class Signal(NamedTuple):
    """What a run is told: time (K,), feed (K, m) added to the loop's control, and the loop itself.

    Args:
        goal, goal_speed: (K, n), what the loop follows.
        kp, kd: (m,), gains of the loop by actuator; zero without a loop.
        limit: (m,), of the control.
        noise: (K, n), of the encoder that closes the loop.
    """

    time: np.ndarray
    feed: np.ndarray
    goal: np.ndarray
    goal_speed: np.ndarray
    kp: np.ndarray
    kd: np.ndarray
    limit: np.ndarray
    noise: np.ndarray


class Motion(NamedTuple):
    """What happened at each row: state (K, n), control applied (K, m), and the sensors without noise (K, n)."""

    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    y: np.ndarray


class _State(NamedTuple):
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    slider: np.ndarray
    creep: np.ndarray
    lag: np.ndarray
    rotor: np.ndarray  # position and speed of the rotor behind a play
    row: np.ndarray  # which control a delayed actuator applies
    work: Work
    M: np.ndarray
    middle: np.ndarray  # (2, n), position and speed in the middle of a step
    forces: np.ndarray  # (2, n), all, and the motors' alone
    speed: np.ndarray
    total: np.ndarray  # impulses of dry friction


def open_loop(time: np.ndarray, controls: np.ndarray, joints: int) -> Signal:
    """Controls that were recorded, applied again."""
    rows, motors = controls.shape
    nothing, none = np.zeros((rows, joints)), np.zeros(motors)
    return Signal(time, controls, nothing, nothing, none, none, np.full(motors, np.inf), nothing)


def simulate(plant: Plant, signal: Signal, q0: np.ndarray, v0: np.ndarray, step: float = FINE) -> Motion:
    """Integrate one run from a state."""
    return Motion(*_run(plant, signal, np.asarray(q0, float), np.asarray(v0, float), step))


@compiled
def _run(plant, signal, q0, v0, step):
    rows, n, m = signal.time.size, q0.size, plant.actuator.shape[0]
    Q, V, U, Y = np.empty((rows, n)), np.empty((rows, n)), np.zeros((rows, m)), np.empty((rows, n))
    state = _State(
        q0.copy(), v0.copy(), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(m),
        np.array([q0[_with_play(plant)], v0[_with_play(plant)]]), np.zeros(m, np.int64),
        room(n), np.empty((n, n)), np.empty((2, n)), np.empty((2, n)), np.empty(n), np.empty(n),
    )  # fmt: skip
    state.creep[:] = q0
    delayed = plant.sensor[:, S.DELAY].max() > 0
    size = int((signal.time[-1] - signal.time[0]) / step) + 2 * rows + 2 if delayed else 1
    past, when, count = np.empty((size, n)), np.empty(size), 0
    for k in range(rows):
        Q[k], V[k] = state.q, state.v
        if delayed:
            past[count], when[count] = state.q, signal.time[k]
            count += 1
        _sense(plant, state, signal.time[k], past, when, count, Y[k])
        _control(plant, signal, k, Y[k], state.v, U[k])
        if k == rows - 1:
            break
        span = signal.time[k + 1] - signal.time[k]
        substeps = max(1, int(np.ceil(span / step - 1e-6)))
        for s in range(substeps):
            now = signal.time[k] + s * span / substeps
            if delayed and s > 0:
                past[count], when[count] = state.q, now
                count += 1
            _step(plant, state, signal.time, U, k, now, span / substeps)
    return Q, V, U, Y


@inlined
def _with_play(plant):
    """Index of the joint with play, or 0."""
    return int(np.argmax(plant.joint[:, J.GAP]))


@inlined
def _sense(plant, state, now, past, when, count, out):
    for j in range(out.size):
        at = now - plant.sensor[j, S.DELAY]
        q = state.q[j]
        if count > 0 and at < now:
            i = np.searchsorted(when[:count], at)
            if i == 0:
                speed = (past[1, j] - past[0, j]) / (when[1] - when[0]) if count > 1 else state.v[j]
                q = past[0, j] + speed * (at - when[0])
            else:
                share = (at - when[i - 1]) / (when[i] - when[i - 1])
                q = past[i - 1, j] + share * (past[i, j] - past[i - 1, j])
        out[j] = plant.sensor[j, S.GAIN] * q + plant.sensor[j, S.BIAS]


@inlined
def _control(plant, signal, k, y, v, out):
    for i in range(out.size):
        j = int(plant.actuator[i, A.JOINT])
        error = signal.goal[k, j] - y[j] - signal.noise[k, j]
        u = signal.feed[k, i] + signal.kp[i] * error + signal.kd[i] * (signal.goal_speed[k, j] - v[j])
        out[i] = min(max(u, -signal.limit[i]), signal.limit[i])


@inlined
def _reaching(state, time, U, k, now, h, delay, i):
    """Mean over a step of the control that reaches an actuator after its delay; rows are no closer than a step."""
    while state.row[i] < k and time[state.row[i] + 1] <= now + 1e-9 - delay:
        state.row[i] += 1
    row = state.row[i]
    begun = now + 1e-9 - delay >= time[0]
    u = U[row, i] if begun else 0.0
    following = row + 1 if begun else 0
    if following <= k:
        share = (time[following] + delay - now) / h
        if share < 1.0:
            u = share * u + (1 - share) * U[following, i]
    return u


@inlined
def _motor(plant, state, middle, time, U, k, clock, i):
    """Torque of an actuator on its joint at the middle of a step; clock: start of the step and its length."""
    now, h = clock
    row = plant.actuator[i]
    u = _reaching(state, time, U, k, now, h, row[A.DELAY], i)
    if row[A.LAG] > 0:
        before = state.lag[i]
        state.lag[i] += (u - before) * (1 - np.exp(-h / row[A.LAG]))
        u = (before + state.lag[i]) / 2
    if row[A.DEAD] > 0:
        u = np.sign(u) * max(abs(u) - row[A.DEAD], 0.0)
    u += row[A.RIPPLE] * np.sin(row[A.RIPPLE_N] * u)
    u = row[A.FACTOR] * (1 + row[A.DRIFT] * now) * u + row[A.BIAS]
    j, gear = int(row[A.JOINT]), row[A.GEAR]
    force = row[A.GAIN] * u + row[A.B0] + gear * (row[A.B1] * middle[0][j] + row[A.B2] * middle[1][j])
    return gear * min(max(force, -row[A.LIMIT]), row[A.LIMIT])


@inlined
def _losses(row, q, v):
    """Forces on a joint that its position and speed set."""
    force = row[J.CONSTANT] - row[J.VISCOUS] * v - row[J.QUADRATIC] * v * abs(v)
    if v > 0:
        force -= row[J.VISCOUS_FORTH] * v
    force -= row[J.SPRING] * (q - row[J.REST]) + row[J.CUBIC] * q**3
    force += row[J.COG1] * np.sin(row[J.COG1_N] * q + row[J.COG1_PHASE])
    force += row[J.COG2] * np.sin(row[J.COG2_N] * q + row[J.COG2_PHASE])
    if q > row[J.STOP_HIGH]:
        force -= max(row[J.STOP_SPRING] * (q - row[J.STOP_HIGH]) + row[J.STOP_DAMPER] * v, 0.0)
    if q < row[J.STOP_LOW]:
        force -= min(row[J.STOP_SPRING] * (q - row[J.STOP_LOW]) + row[J.STOP_DAMPER] * v, 0.0)
    return force


@inlined
def _oddities(plant, state, j, q, v, now):
    """Forces that no name of the contract describes."""
    row = plant.joint[j]
    x = (q[j] - row[J.BUMP_AT]) / row[J.BUMP_WIDTH]
    force = row[J.BUMP] * x * np.exp(-x * x)
    force += row[J.HUM] * np.sin(2 * np.pi * row[J.HUM_HZ] * now + row[J.HUM_PHASE])
    if abs(q[j] - row[J.POCKET_AT]) < row[J.POCKET_WIDTH]:
        force += row[J.POCKET] * (q[j] - row[J.POCKET_AT])
    force += row[J.SWIRL] * v[j] * np.sin(row[J.SWIRL_N] * q[j])
    force += row[J.CROSS] * q[int(row[J.CROSS_WITH])]
    force -= row[J.CREEP] * (q[j] - state.creep[j])
    return force


@inlined
def _memory(plant, state, j, q, v, h):
    """Move the slider of a hysteresis and the dashpot of a creep; return the slider's force."""
    row = plant.joint[j]
    state.creep[j] += (q - state.creep[j]) * h / row[J.CREEP_TIME]
    if row[J.SLIP_SPRING] == 0:
        return 0.0
    most = row[J.SLIP] / row[J.SLIP_SPRING]
    state.slider[j] = min(max(state.slider[j] + v * h, -most), most)
    return -row[J.SLIP_SPRING] * state.slider[j]


@inlined
def _wall(row, q, v, acceleration, mobility):
    """Force of the nominal model's contact along a slide, in continuous time."""
    depth = q - row[J.WALL]
    if depth <= 0:
        return 0.0
    x = min(depth / 0.001, 1.0)
    rise = 2 * x * x if x < 0.5 else 1 - 2 * (1 - x) ** 2
    d = 0.9 + 0.05 * rise
    wanted = -row[J.WALL_DAMPER] * (-v) - row[J.WALL_SPRING] * d * (-depth)
    return -max(0.0, (wanted + acceleration) / (mobility + (1 - d) / d * row[J.WALL_SOFT]))


@inlined
def _predict(plant, state, time, U, k, now, h):
    """Mass matrix and forces in the middle of a step; returns the torque on a rotor that is behind a play."""
    n, joint, play = state.q.size, plant.joint, _with_play(plant)
    has_play, rotor_torque = joint[play, J.GAP] > 0, 0.0
    q, v, M, force, load = state.middle[0], state.middle[1], state.M, state.forces[0], state.forces[1]
    for j in range(n):
        q[j], v[j], load[j] = state.q[j] + h / 2 * state.v[j], state.v[j] + h / 2 * state.a[j], 0.0
    mass_and_bias(plant.tree, q, v, state.work, M, force)
    for i in range(plant.actuator.shape[0]):
        load[int(plant.actuator[i, A.JOINT])] += _motor(plant, state, (q, v), time, U, k, (now, h), i)
    for j in range(n):
        driven = load[j]
        if has_play and j == play:
            rotor_torque, driven = driven, 0.0
        else:
            M[j, j] += joint[j, J.ROTOR]
        force[j] = driven - force[j] + _losses(joint[j], q[j], v[j]) + _oddities(plant, state, j, q, v, now + h / 2)
        force[j] += _memory(plant, state, j, q[j], v[j], h)
    return rotor_torque


@inlined
def _step(plant, state, time, U, k, now, h):
    n, joint = state.q.size, plant.joint
    play = _with_play(plant)
    has_play = joint[play, J.GAP] > 0
    q, v, M, force, load = state.middle[0], state.middle[1], state.M, state.forces[0], state.forces[1]
    rotor_torque = _predict(plant, state, time, U, k, now, h)
    invert(M)
    inverse, speed = M, state.speed
    for j in range(n):
        a = 0.0
        for i in range(n):
            a += inverse[j, i] * force[i]
        if joint[j, J.WALL] < np.inf:  # such a machine has one joint
            a += inverse[j, j] * _wall(joint[j], q[j], v[j], a, inverse[j, j])
        speed[j] = state.v[j] + h * a
    if has_play:
        state.rotor[1] += h * rotor_torque / joint[play, J.ROTOR]
    _impulses(plant, state, load, inverse, speed, h)
    if has_play:
        state.rotor[0] += h * state.rotor[1]
    for j in range(n):
        state.q[j] += h / 2 * (state.v[j] + speed[j])
        state.a[j] = (speed[j] - state.v[j]) / h
        state.v[j] = speed[j]


@inlined
def _dry(row, v, load):
    """Levels of dry friction against forward and backward motion."""
    more = row[J.STATIC] * np.exp(-((v / row[J.STRIBECK]) ** 2)) + row[J.LOADED] * abs(load)
    return row[J.DRY_FORTH] + more, row[J.DRY_BACK] + more


@compiled
def _impulses(plant, state, load, inverse, speed, h):
    """Change the speeds by what dry friction and play allow."""
    n = speed.size
    play = _with_play(plant)
    gap, total, closed = plant.joint[play, J.GAP], state.total, 0.0
    for j in range(n):
        total[j] = 0.0
    for _ in range(60):
        change = 0.0
        for j in range(n):
            forth, back = _dry(plant.joint[j], state.v[j], load[j])
            if forth == 0 and back == 0:
                continue
            old = total[j]
            total[j] = min(max(old - speed[j] / inverse[j, j], -h * forth), h * back)
            for i in range(n):
                speed[i] += inverse[j, i] * (total[j] - old)
            change = max(change, abs(inverse[j, j] * (total[j] - old)))
        if gap > 0:
            moved, closed = _close(plant, state, inverse, speed, closed, h)
            change = max(change, moved)
        if change < 1e-12:
            break


@inlined
def _close(plant, state, inverse, speed, closed, h):
    """One projection of the play's impulse on the rotor; what stays open a little is pushed back within 2 ms."""
    play = _with_play(plant)
    rotor, gap = plant.joint[play, J.ROTOR], plant.joint[play, J.GAP]
    off = state.rotor[0] - state.q[play]
    mobility = 1 / rotor + inverse[play, play]
    relative = state.rotor[1] - speed[play]
    side = 1.0 if off > 0 else -1.0
    if side * off < gap / 2:
        return 0.0, closed
    wanted = -side * (side * off - gap / 2) / 0.002
    new = closed + (wanted - relative) / mobility
    new = min(new, 0.0) if side > 0 else max(new, 0.0)
    state.rotor[1] += (new - closed) / rotor
    speed -= inverse[play] * (new - closed)
    return abs(new - closed) * mobility, new
