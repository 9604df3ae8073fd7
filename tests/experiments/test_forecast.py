from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict

from torch_activegp.experiments.forecast import forecast, positions_of, signal_scale
from torch_activegp.simulators import ActionSpace, FunctionSimulator, Simulator, StateSpace

NAMES = ("qpos.x", "qvel.x")


def cart(drift: float = 0.0, angle: bool = False, names: tuple[str, str] = NAMES) -> Simulator:
    """Position and velocity; the control changes the velocity, and a wrong model adds a drift to the position."""

    def move(state: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        position, velocity = state.unbind(-1)
        following = torch.stack([position + 0.1 * velocity + drift, velocity + action[..., 0]], dim=-1)
        return torch.where(following.abs() < 1e6, following, torch.nan)

    space = StateSpace(names, -math.inf, math.inf, angles=[0] if angle else [])
    return FunctionSimulator(move, space, ActionSpace(["ctrl.u"], -1.0, 1.0), dt=0.1)


def recorded(simulator: Simulator, length: int = 23, seed: int = 0) -> TensorDict:
    actions = torch.randn(length, 1, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    states = simulator.rollout(torch.zeros(2).double(), actions)
    before = torch.cat([torch.zeros(1, 2).double(), states[:-1]])
    return TensorDict({"state": before, "action": actions, "next": {"state": states}}, [length])


def test_a_right_simulator_has_no_error() -> None:
    result = forecast(cart(), [recorded(cart()), recorded(cart(), 7, 1)], window=0.5)
    for errors in (result.one_step, result.window, result.free_run):
        assert max(errors.rmse.values()) < 1e-12
        assert errors.position_nrmse < 1e-12
        assert errors.diverged_after is None
    assert [states.shape for states in result.free_states] == [(23, 2), (7, 2)]
    assert [states.shape for states in result.window_states] == [(4, 5, 2), (1, 5, 2)]


def test_errors_add_up_as_the_forecast_gets_longer() -> None:
    run = recorded(cart())
    result = forecast(cart(drift=0.01), [run], window=0.5)
    drift = 0.01 * torch.arange(1, 24).double()
    rms = lambda values: values.square().mean().sqrt().item()  # noqa: E731
    assert result.one_step.rmse["qpos.x"] == pytest.approx(0.01)
    assert result.window.rmse["qpos.x"] == pytest.approx(rms(drift[:5]))
    assert result.free_run.rmse["qpos.x"] == pytest.approx(rms(drift))
    assert result.free_run.rmse["qvel.x"] == 0.0
    scale = run["next", "state"].std(0)
    assert result.free_run.nrmse["qpos.x"] == pytest.approx(rms(drift) / scale[0].item(), rel=1e-6)
    assert result.free_run.position_nrmse == pytest.approx(result.free_run.nrmse["qpos.x"])
    torch.testing.assert_close(result.free_states[0][:, 0], run["next", "state"][:, 0] + drift)


def test_runs_are_pooled_and_a_window_longer_than_a_run_is_the_run() -> None:
    runs = [recorded(cart(), 20), recorded(cart(), 5, 1)]
    result = forecast(cart(drift=0.01), runs, window=1.0)
    squares = [(0.01 * torch.arange(1, length + 1)) ** 2 for length in (10, 10, 5)]
    assert result.window.rmse["qpos.x"] == pytest.approx(torch.cat(squares).mean().sqrt().item())


def test_a_diverged_forecast_is_infinite_and_says_when() -> None:
    result = forecast(cart(drift=4e5), [recorded(cart(), 8)], window=0.2)
    assert result.free_run.diverged_after == pytest.approx(0.3)  # the third step passes 1e6
    assert result.free_run.rmse["qpos.x"] == result.free_run.position_nrmse == math.inf
    assert result.window.diverged_after is None
    assert result.one_step.rmse["qpos.x"] == pytest.approx(4e5)


def test_angles_are_compared_on_the_circle() -> None:
    run = recorded(cart())
    turned = run.clone()
    turned["next", "state"][:, 0] += 2 * math.pi
    assert forecast(cart(angle=True), [turned], window=0.5).one_step.rmse["qpos.x"] < 1e-12
    assert forecast(cart(), [turned], window=0.5).one_step.rmse["qpos.x"] == pytest.approx(2 * math.pi)


def test_the_scale_of_an_angle_follows_it_across_the_seam() -> None:
    way = 3.0 + 0.5 * torch.sin(torch.arange(100).double() / 5)
    wrapped = torch.stack([torch.remainder(way + math.pi, 2 * math.pi) - math.pi, 0 * way], dim=-1)
    scale = signal_scale(cart(angle=True), [wrapped])
    assert scale.tolist() == pytest.approx([way.std().item(), 1.0])  # a constant state has 1
    assert signal_scale(cart(), [wrapped])[0] > 2.0
    spinning = torch.stack([torch.arange(1000).double(), torch.arange(1000).double()], dim=-1)
    assert signal_scale(cart(angle=True), [spinning])[0].item() == pytest.approx(math.pi / math.sqrt(3))


def test_positions_are_known_by_name() -> None:
    assert positions_of(cart()) == [0]
    assert positions_of(cart(names=("a", "b"))) == [0, 1]
