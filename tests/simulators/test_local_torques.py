from __future__ import annotations

import math

import pytest
import torch

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.local_torques import JointStop, LocalBrake, Magnet
from torch_activegp.simulators.pendulum import Pendulum

DOUBLE = torch.float64


@pytest.mark.parametrize("extra", [LocalBrake, Magnet, lambda **options: JointStop(position=1.2, **options)])
def test_an_extra_torque_adds_to_the_motor(extra) -> None:
    pendulum, plain = Pendulum(extra_torque=extra()), Pendulum()
    theta, speed = torch.tensor([1.3, -2.0], dtype=DOUBLE), torch.tensor([1.0, 1.0], dtype=DOUBLE)
    change = pendulum.acceleration(theta, speed, torch.zeros(2)) - plain.acceleration(theta, speed, torch.zeros(2))
    torch.testing.assert_close(change, 3.0 * extra()(theta, speed))
    assert change[0].abs() > 0.5
    assert change[1].abs() < 1e-6  # far away the prior is right


def test_the_brake_takes_energy_near_its_center_across_the_cut_of_the_circle() -> None:
    brake = LocalBrake(center=math.pi, width=0.2, damping=0.7)
    theta = torch.tensor([math.pi, math.pi - 0.2, -math.pi + 0.2], dtype=DOUBLE)
    speed = torch.tensor([2.0, -1.0, 1.0], dtype=DOUBLE)
    expected = [-1.4, 0.7 * math.exp(-0.5), -0.7 * math.exp(-0.5)]
    assert brake(theta, speed).tolist() == pytest.approx(expected)


def test_the_magnet_pulls_strongest_one_width_away() -> None:
    magnet = Magnet(center=3.0, width=0.3, strength=0.8)
    theta = torch.tensor([3.0, 2.7, 3.3 - 2 * math.pi], dtype=DOUBLE)
    assert magnet(theta, theta).tolist() == pytest.approx([0.0, 0.8, -0.8])
    scan = magnet(torch.linspace(-math.pi, math.pi, 10_001, dtype=DOUBLE), theta[:1])
    assert scan.abs().max().item() == pytest.approx(0.8, abs=1e-5)


@pytest.mark.parametrize("extra", [LocalBrake, Magnet, lambda **options: JointStop(position=1.2, **options)])
def test_extra_torques_can_be_fitted(extra) -> None:
    pendulum = Pendulum(extra_torque=extra(trainable=True))
    pendulum(torch.tensor([1.3, 1.0], dtype=DOUBLE), torch.zeros(1, dtype=DOUBLE)).sum().backward()
    gradients = [parameter.grad.item() for parameter in pendulum.parameters()]
    assert len(gradients) == 3
    assert all(gradient != 0.0 for gradient in gradients)


def test_the_stop_pushes_back_and_damps_only_past_its_position_and_only_on_the_way_in() -> None:
    stop = JointStop(position=2.0, stiffness=10.0, damping=3.0, depth=0.1)
    theta = torch.tensor([1.9, 2.05, 2.2, 2.2], dtype=DOUBLE)
    speed = torch.tensor([4.0, 2.0, 2.0, -2.0], dtype=DOUBLE)
    assert stop(theta, speed).tolist() == pytest.approx([0.0, -0.5 - 3.0, -2.0 - 6.0, -2.0])


@pytest.mark.parametrize(
    "build", [lambda: LocalBrake(width=0.0), lambda: Magnet(width=-1.0), lambda: JointStop(depth=0.0)]
)
def test_errors_say_what_is_wrong(build) -> None:
    with pytest.raises(ConfigurationError, match="` > 0 rad"):
        build()
