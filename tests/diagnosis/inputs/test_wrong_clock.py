from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis import diagnose, evaluate
from torch_activegp.diagnosis.inputs.wrong_clock import check_clock_unit
from torch_activegp.errors import DataError


def at(apart: float) -> Recording:
    """Rows so far apart, s."""
    return Recording.from_columns("log.csv", {"time": apart * np.arange(9.0), "qpos.hip": np.zeros(9)})


@pytest.mark.parametrize(
    ("factor", "rate", "unit"),
    [(1e3, 100, "ms"), (1e3, 1000, "ms"), (1e6, 100, "us"), (1e9, 500, "ns"), (1e3, 20, "ms")],
)
def test_times_in_another_unit_are_refused_by_name(model, factor: float, rate: float, unit: str) -> None:
    with pytest.raises(DataError, match="log.csv, column `time`: s wanted, found rows") as refused:
        check_clock_unit(model, [at(0.01), at(factor / rate)])
    assert f'time = {{ column = "...", unit = "{unit}" }}' in str(refused.value)
    assert f"In {unit} they would be {1 / rate:.3g} s apart" in str(refused.value)


def test_times_in_seconds_that_were_said_to_be_milliseconds_are_refused(model) -> None:
    with pytest.raises(DataError, match="found rows 1e-05 s apart, 500 in each time step of the model. Check the unit"):
        check_clock_unit(model, [at(1e-5)])


@pytest.mark.parametrize("apart", [2.5e-5, 1e-3, 0.1, 0.49, 0.99])
def test_what_a_machine_may_have_is_taken(model, apart: float) -> None:
    """A model in steps of 5 ms."""
    check_clock_unit(model, [at(apart)])


def test_a_model_in_long_steps_may_be_slow() -> None:
    slow = mujoco.MjModel.from_xml_string("<mujoco><option timestep='0.1'/></mujoco>")
    check_clock_unit(slow, [at(10.0)])
    with pytest.raises(DataError):
        check_clock_unit(slow, [at(20.0)])


def test_it_is_asked_before_anything_is_simulated(model, record) -> None:
    run = record()
    late = Recording.from_columns("run", {name: run[name] for name in run.columns} | {"time": 1e3 * run.time})
    for ask in (diagnose, evaluate):
        with pytest.raises(DataError, match='unit = "ms"'):
            ask(model, [late])
