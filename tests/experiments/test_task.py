from __future__ import annotations

import math

import gpytorch
import pytest
import torch

from torch_activegp.errors import ConfigurationError, SimulationError
from torch_activegp.experiments.task import FITTED, PRINTED, TASKS, GPSettings, Task
from torch_activegp.models import FixedNoise, fit_hyperparameters
from torch_activegp.simulators import ActionSpace, FunctionSimulator, Pendulum, Simulator, StateSpace


def line(names: list[str], bound: float = 1.0, dt: float = 0.1, **space: object) -> Simulator:
    """A simulator that stands still."""
    states = StateSpace(names, -bound, bound, **space)
    return FunctionSimulator(lambda state, action: state + 0 * action[..., :1], states, ActionSpace(["u"], -1, 1), dt)


@pytest.mark.parametrize("name", TASKS)
def test_a_built_in_task_is_named_described_and_imperfect(name: str) -> None:
    task = TASKS[name]()
    assert task.name == name
    assert "theta''" in task.description
    z, following = task.test_points()
    prior = task.prior(z[:, :2], z[:, 2:])
    error = task.truth.state_space.difference(prior, following).square().mean()
    assert len(z) == 20**3
    assert 1e-3 < error < 1


@pytest.mark.parametrize(
    ("name", "acceleration"),
    [("pendulum", -3 * 9.81 * math.sin(0.5) + 3 * 0.2), ("pendulum-gymnasium", 1.5 * 9.81 * math.sin(0.5) + 3 * 0.2)],
)
def test_each_pendulum_obeys_the_equation_that_it_names(name: str, acceleration: float) -> None:
    task = TASKS[name]()
    following = task.truth(torch.tensor([0.5, 0.0]).double(), torch.tensor([0.2]).double())
    assert following[1].item() == pytest.approx(0.05 * acceleration)
    assert ("Gymnasium" in task.description) == (name == "pendulum-gymnasium")


def test_the_brake_is_wrong_only_near_its_place() -> None:
    task = TASKS["pendulum-brake"]()
    z, following = task.test_points()
    error = (task.prior(z[:, :2], z[:, 2:]) - following).abs().amax(-1)
    far = (z[:, 0] - 1.2).abs() > 1.2
    assert error[far].max() < 1e-4
    assert error[~far].max() > 0.05


@pytest.mark.parametrize(
    ("truth", "prior", "message"),
    [
        (line(["x"]), line(["y"]), r"same states .* \['x'\] in `FunctionSimulator` and \['y'\]"),
        (line(["x"]), Pendulum(), "same states"),
        (line(["x"]), line(["x"], dt=0.2), "one time step, found 0.1 s .* 0.2 s"),
        (line(["x"], bound=math.inf), line(["x"]), "found none for x. .*--bounds x=LOW:HIGH"),
        (line(["x"]), line(["x"], bound=math.inf), "found none for x"),
    ],
)
def test_what_cannot_be_explored_is_refused(truth: Simulator, prior: Simulator, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        Task("mine", truth, prior, PRINTED)


def test_actions_must_be_the_same() -> None:
    other = FunctionSimulator(lambda s, a: s, line(["x"]).state_space, ActionSpace(["force"], -1, 1), 0.1)
    with pytest.raises(ConfigurationError, match=r"same actions .*\['u'\].*\['force'\]"):
        Task("mine", line(["x"]), other, PRINTED)


def test_few_dimensions_get_a_grid_and_many_a_sobol_set_within_the_bounds() -> None:
    few = Task("few", line(["x"]), line(["x"]), PRINTED, grid=3)
    z, following = few.test_points()
    assert z.unique(dim=0).tolist() == [[x, u] for x in (-1, 0, 1) for u in (-1, 0, 1)]
    assert torch.equal(following, z[:, :1])
    many = line(["x", "w", "i", "j", "k"], quaternions=[1])
    z, _ = Task("many", many, many, PRINTED, grid=5).test_points()
    assert z.shape == (125, 6)
    assert len(z.unique(dim=0)) == 125
    assert torch.allclose(z[:, 1:5].norm(dim=-1), torch.ones(125, dtype=z.dtype))
    assert z.abs().max() <= 1


def test_a_true_system_that_fails_somewhere_is_named_with_the_place() -> None:
    broken = FunctionSimulator(
        lambda s, a: torch.where(s > 0.9, torch.inf, s), line(["x"]).state_space, line(["x"]).action_space, 0.1
    )
    with pytest.raises(SimulationError, match=r"`FunctionSimulator` returned \[inf\] from state {'x': 1.0}"):
        Task("mine", broken, line(["x"]), PRINTED).test_points()


def test_the_printed_settings_are_the_papers() -> None:
    pendulum = Pendulum()
    gp = PRINTED.make(pendulum, with_prior=True)
    z = torch.rand(6, 3, dtype=torch.float64)
    covariance = gp.covar_module(z).to_dense()
    assert torch.allclose(covariance, torch.exp(-0.5 * torch.cdist(z, z).square()))
    gp.update(z[:, :2], z[:, 2:], pendulum(z[:, :2], z[:, 2:]))
    assert gp.likelihood.noise.flatten().tolist() == pytest.approx([1 / 36, 1 / 36])
    assert not PRINTED.fitted


@pytest.mark.parametrize("with_prior", [True, False])
def test_the_prior_is_the_mean_or_zero(with_prior: bool) -> None:
    pendulum = Pendulum()
    gp = PRINTED.make(pendulum, with_prior=with_prior)
    z = torch.rand(6, 3, dtype=torch.float64)
    loc = gp.posterior.loc(gp.posterior.features(z))
    assert torch.allclose(loc, pendulum(z[:, :2], z[:, 2:]) * with_prior)
    assert gp.mean_module.recursion == "paper"


def test_length_scales_and_output_scales_reach_the_gp() -> None:
    settings = GPSettings((0.5, 1.0, 2.0), FixedNoise(1e-2), "bayes", output_scale=(0.1, 3.0))
    gp = settings.make(Pendulum(), with_prior=True)
    assert isinstance(gp.covar_module, gpytorch.kernels.RBFKernel)
    assert gp.covar_module.lengthscale.flatten().tolist() == [0.5, 1.0, 2.0]
    assert gp.output_scale.tolist() == [0.1, 3.0]
    assert gp.mean_module.recursion == "bayes"


def test_fitted_settings_learn_even_where_one_state_is_predicted_exactly(generator: torch.Generator) -> None:
    states, actions = StateSpace(["x", "v"], -1.0, 1.0), ActionSpace(["u"], -1.0, 1.0)

    def move(gain: float) -> Simulator:
        def step(state: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
            return torch.cat([state[..., :1] + 0.1 * state[..., 1:], state[..., 1:] + gain * action], dim=-1)

        return FunctionSimulator(step, states, actions, 0.1)

    gp = FITTED.make(move(0.05), with_prior=True)
    assert FITTED.fitted
    x, u = states.sample((30,), generator), actions.sample((30,), generator)
    gp.update(x, u, move(0.1)(x, u))
    fit_hyperparameters(gp)
    z = torch.cat([states.sample((100,), generator), actions.sample((100,), generator)], dim=-1)
    error = gp.posterior.loc(gp.posterior.features(z)) - move(0.1)(z[:, :2], z[:, 2:])
    assert error.abs().max() < 1e-3
