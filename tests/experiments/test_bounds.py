from __future__ import annotations

import pytest
import torch

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.bounds import set_bounds
from torch_activegp.simulators import MujocoSimulator, Pendulum

ARM = """
<mujoco>
  <worldbody>
    <body>
      <joint name='hip'/><geom size='.1'/>
      <body pos='1 0 0'><joint name='knee' range='0 90'/><geom size='.1'/></body>
    </body>
  </worldbody>
  <actuator><motor joint='hip' name='m' ctrlrange='-1 1'/></actuator>
</mujoco>"""


def test_a_prefix_stands_for_all_its_dimensions_and_the_rest_stays() -> None:
    simulator, untouched = MujocoSimulator(ARM), MujocoSimulator(ARM)
    set_bounds(simulator, {"qvel": (-5.0, 6.0), "ctrl.m": (0.0, 0.5)})
    assert simulator.state_space.low[2:].tolist() == [-5.0, -5.0]
    assert simulator.state_space.high[2:].tolist() == [6.0, 6.0]
    assert (simulator.action_space.low.item(), simulator.action_space.high.item()) == (0.0, 0.5)
    assert torch.equal(simulator.state_space.high[:2], untouched.state_space.high[:2])
    assert simulator.state_space.angles == untouched.state_space.angles == (0,)
    state, action = torch.rand(4, 4, dtype=torch.float64), torch.zeros(4, 1, dtype=torch.float64)
    assert torch.equal(simulator(state, action), untouched(state, action))


def test_the_later_bound_wins() -> None:
    simulator = MujocoSimulator(ARM)
    set_bounds(simulator, {"qvel": (-5.0, 5.0), "qvel.knee": (-1.0, 1.0)})
    assert simulator.state_space.high[2:].tolist() == [5.0, 1.0]


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ({"theta": (1.0, -1.0)}, "low <= high"),
        ({"thet": (-1.0, 1.0)}, "no state or action `thet`; there are theta, theta_dot, torque"),
    ],
)
def test_bad_bounds_are_refused(bounds: dict[str, tuple[float, float]], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        set_bounds(Pendulum(), bounds)
