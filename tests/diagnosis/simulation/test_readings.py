from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.readings import earlier, readings


def test_earlier_is_exact_for_a_cubic_and_holds_the_start() -> None:
    time = np.arange(11) * 0.1
    position = (time**3 - time)[None, None]
    velocity = (3 * time**2 - 1)[None, None]
    late = earlier(position, velocity, np.full((1, 10), 0.1), np.array([0.13]))
    before = np.maximum(time - 0.13, 0.0)
    np.testing.assert_allclose(late[0, 0], before**3 - before, atol=1e-12)


def test_each_candidate_reads_through_its_own_sensor(bench) -> None:
    gain, bias = bench.effect("sensor_gain", "sensor:hip"), bench.effect("sensor_bias", "sensor:hip")
    rng = np.random.default_rng(0)
    position, velocity = rng.normal(size=(2, 3, 2, 5, 1))
    candidates = [NOMINAL, Candidate((gain,), (np.array([0.5]),)), Candidate((bias,), (np.array([0.2]),))]
    read = readings(candidates, position, velocity, np.full((2, 4), 0.01))
    np.testing.assert_allclose(read, [position[0], 1.5 * position[1], position[2] + 0.2])


def test_without_a_sensors_effect_nothing_is_copied(bench) -> None:
    position = np.zeros((1, 1, 3, 1))
    friction = Candidate((bench.effect("viscous_friction"),), (np.array([1.0]),))
    assert readings([friction], position, position, np.ones((1, 2))) is position


def test_bias_and_gain_act_together(bench) -> None:
    effects = (bench.effect("sensor_gain", "sensor:hip"), bench.effect("sensor_bias", "sensor:hip"))
    position = np.ones((1, 1, 3, 1))
    read = readings([Candidate(effects, (np.array([1.0]), np.array([0.5])))], position, position, np.ones((1, 2)))
    assert (read == 2.5).all() and (position == 1.0).all()
