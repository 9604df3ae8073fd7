"""What a user would move to a GPU gives there what it gives on the CPU. Skipped where there is none."""

from __future__ import annotations

from pathlib import Path

import gpytorch
import pytest
import torch
from tensordict import TensorDict

from torch_activegp import keys
from torch_activegp.acquisition import prior_discrepancy
from torch_activegp.collectors import LargestScoreStart
from torch_activegp.envs import GPEnv, SimulatorEnv
from torch_activegp.loops import ActiveLearning
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, InverseSquareNoise
from torch_activegp.planners import ICEMPlanner
from torch_activegp.simulators import MujocoSimulator, Pendulum

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


def make_gp() -> DynamicsGP:
    mean = EpisodicMean(SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0)))
    return DynamicsGP(mean, gpytorch.kernels.RBFKernel(), noise=InverseSquareNoise())


def make_loop(device: str, checkpoint: Path) -> ActiveLearning:
    """The README's loop, small, with all of it on one device; chance comes from generators on the CPU."""
    gp = make_gp().to(device)
    env = GPEnv(gp, prior_discrepancy())
    sizes = {"optim_steps": 3, "num_candidates": 16, "top_k": 4, "num_kept": 2}
    planner = ICEMPlanner(env, planning_horizon=4, generator=torch.Generator().manual_seed(1), **sizes)
    machine = SimulatorEnv(Pendulum().to(device), noise_scale=0.001, seed=2)
    start = LargestScoreStart(gp, Pendulum().to(device).action_space, num_candidates=32, num_rounds=2, seed=3)
    return ActiveLearning(machine, planner, gp, start=start, episode_length=5, checkpoint=checkpoint)


def test_a_loop_learns_the_same(tmp_path: Path) -> None:
    z = torch.linspace(-2, 2, 30, dtype=torch.float64).reshape(10, 3)
    found = {}
    for device in ("cpu", "cuda"):
        loop = make_loop(device, tmp_path / f"{device}.pt")
        list(loop.run(num_episodes=2))
        assert all(value.device.type == device for value in loop.episodes[-1].values(True, True))
        with torch.no_grad():
            found[device] = loop.model(z[:, :2].to(device), z[:, 2:].to(device))
    assert found["cuda"].device.type == "cuda"
    torch.testing.assert_close(found["cuda"].cpu(), found["cpu"], rtol=0, atol=1e-5)


def test_a_loop_resumes_as_if_it_had_not_stopped(tmp_path: Path) -> None:
    whole = make_loop("cuda", tmp_path / "whole.pt")
    list(whole.run(num_episodes=2))
    list(make_loop("cuda", tmp_path / "halves.pt").run(num_episodes=1))
    halves = make_loop("cuda", tmp_path / "halves.pt")
    halves.resume()
    list(halves.run(num_episodes=2))
    torch.testing.assert_close(halves.gp.inputs, whole.gp.inputs, rtol=0, atol=0)


def test_scores_and_rollouts_in_a_learned_model() -> None:
    gp = make_gp()
    generator = torch.Generator().manual_seed(0)
    state = torch.randn(40, 2, generator=generator, dtype=torch.float64)
    action = torch.rand(40, 1, generator=generator, dtype=torch.float64)
    gp.update(state, action, Pendulum()(state, action))
    env = GPEnv(gp, prior_discrepancy())
    here = env.rollout(5, tensordict=TensorDict({keys.STATE: state[:3]}, [3]), auto_reset=False, policy=_push)
    gp.to("cuda")
    moved = GPEnv(gp, prior_discrepancy())
    begin = TensorDict({keys.STATE: state[:3].cuda()}, [3], device="cuda")
    there = moved.rollout(5, tensordict=begin, auto_reset=False, policy=_push)
    for key in (keys.STATE, ("next", keys.STATE), ("next", keys.REWARD)):
        torch.testing.assert_close(there[key].cpu(), here[key], rtol=1e-8, atol=1e-9)


def _push(td: TensorDict) -> TensorDict:
    """A torque of 0.3."""
    return td.set(keys.ACTION, torch.full_like(td[keys.STATE][..., :1], 0.3))


def test_mujoco_takes_states_from_a_gpu_and_gives_them_back() -> None:
    xml = """<mujoco><worldbody><body><joint name="hip" axis="0 1 0"/>
    <inertial pos="0 0 -0.5" mass="1" diaginertia="0.1 0.1 0.01"/></body></worldbody>
    <actuator><motor name="drive" joint="hip"/></actuator></mujoco>"""
    simulator = MujocoSimulator(xml)
    state, action = torch.tensor([[0.3, 1.0], [1.0, -2.0]], dtype=torch.float64), torch.tensor([[0.1], [0.2]])
    there = simulator(state.cuda(), action.cuda())
    assert there.device.type == "cuda"
    torch.testing.assert_close(there.cpu(), simulator(state, action), rtol=0, atol=0)
    mean = SimulatorMean(simulator).to("cuda")
    assert mean(torch.cat((state, action), -1).cuda()).device.type == "cuda"
