"""HeldOutEpisodes: each episode tests the model of its first moment, and only a correction that pays is trusted."""

from __future__ import annotations

from copy import deepcopy
from types import ModuleType

import pytest
import torch
from torch import Tensor

from torch_activegp.errors import ConfigurationError
from torch_activegp.loops import HeldOutEpisodes
from torch_activegp.models import FixedNoise, InverseSquareNoise, NoiseSchedule
from torch_activegp.simulators import Pendulum

ACTIONS = Pendulum().action_space


def episode(gp: torch.nn.Module, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    state, action = gp.state_space.sample((5,), generator), ACTIONS.sample((5,), generator)
    return state, action, Pendulum().step(state, action)


@pytest.mark.parametrize("recursion", ["paper", "bayes"])
@pytest.mark.parametrize("noise", [FixedNoise(1e-3), InverseSquareNoise()], ids=["appended", "refactored"])
def test_the_model_of_the_first_moment_is_tested(
    small_run: ModuleType, generator: torch.Generator, noise: NoiseSchedule, recursion: str
) -> None:
    gp = small_run.make_gp(noise, recursion)
    guard, wanted = HeldOutEpisodes(gp), []
    for _ in range(3):
        frozen, (state, action, following) = deepcopy(gp), episode(gp, generator)
        guard.begin()
        for row in range(5):
            gp.update(state[row : row + 1], action[row : row + 1], following[row : row + 1])
        guard.end(state, action, following)
        posterior = frozen.posterior
        features = posterior.features(torch.cat([state, action], -1))
        errors = [gp.state_space.difference(following, p) for p in (features.simulator_loc, posterior.loc(features))]
        wanted.append(torch.stack(errors).square().sum(1).detach())
        gp.begin_episode()
    squared, product, correction, count = torch.stack(guard.sums).unbind(1)
    torch.testing.assert_close(squared, torch.stack(wanted)[:, 0])
    torch.testing.assert_close(squared - 2 * product + correction, torch.stack(wanted)[:, 1])
    assert (correction[0] == 0).all()  # nothing was learned yet
    assert (count == 5).all()
    report = guard.report()
    torch.testing.assert_close(report.simulator_rmse.square(), squared.sum(0) / 15)
    torch.testing.assert_close(report.model_rmse.square(), torch.stack(wanted)[:, 1].sum(0) / 15)


def sums(gains: list[float]) -> list[Tensor]:
    """Tests of 2 states in which the correction of the first brings these gains, and that of the second is 0."""
    return [torch.tensor([[9.0, 9.0], [(1.0 + gain) / 2, 0.0], [1.0, 0.0], [4.0, 4.0]]).double() for gain in gains]


@pytest.mark.parametrize(
    ("gains", "trusted"),
    [
        ([0.5, 0.5, 0.5], True),
        ([-0.1, -0.1, -0.1], False),
        ([1.0, 1.0, 0.9], True),
        ([1.0, 1.0, -0.4], True),
        ([3.0, -0.1, -0.1], False),  # one lucky episode: mean 0.93, standard error 1.03
        ([-1.0, -1.0, -1.0], False),
        ([-1.0, 1.5, 0.0], False),
    ],
)
def test_a_correction_is_trusted_where_its_mean_gain_exceeds_its_standard_error(
    small_run: ModuleType, gains: list[float], trusted: bool
) -> None:
    guard = HeldOutEpisodes(small_run.make_gp())
    guard.sums = sums(gains)
    assert guard.trust().tolist() == [float(trusted), 1.0]
    report = guard.report()
    assert report.stepped_in is not trusted
    assert torch.equal(report.trust, guard.trust())
    assert torch.equal(report.guarded_rmse[:1], (report.model_rmse if trusted else report.simulator_rmse)[:1])
    assert ("guard stepped in" in str(report)) is not trusted
    if not trusted:
        assert "theta (" in str(report)
        assert "0 % of the correction kept" in str(report)


def test_a_gain_by_chance_is_not_called_worse(small_run: ModuleType) -> None:
    guard = HeldOutEpisodes(small_run.make_gp())
    guard.sums = sums([3.0, -0.1, -0.1])
    assert "not reliably better than the simulator alone in theta" in str(guard.report())
    guard.sums = sums([-3.0] * 3)
    assert "worse than the simulator alone in theta" in str(guard.report())


def test_episodes_before_anything_was_learned_are_no_tests(small_run: ModuleType) -> None:
    guard = HeldOutEpisodes(small_run.make_gp())
    assert guard.trust().tolist() == [0.0, 0.0]
    nothing = torch.tensor([[9.0, 9.0], [0.0, 0.0], [0.0, 0.0], [4.0, 4.0]], dtype=torch.float64)
    guard.sums = [nothing] * 3
    assert guard.trust().tolist() == [0.0, 0.0]
    guard.sums = [nothing, *sums([0.5, 0.5])]
    assert guard.trust().tolist() == [0.0, 0.0]  # two tests are too few
    guard.sums = [nothing, *sums([0.5, 0.5, 0.5])]
    assert guard.trust().tolist() == [1.0, 1.0]


def test_an_end_without_a_beginning_is_an_error(small_run: ModuleType, generator: torch.Generator) -> None:
    gp = small_run.make_gp()
    with pytest.raises(ConfigurationError, match="Call begin"):
        HeldOutEpisodes(gp).end(*episode(gp, generator))


def test_only_the_last_episodes_count(small_run: ModuleType, generator: torch.Generator) -> None:
    gp = small_run.make_gp()
    guard, seen = HeldOutEpisodes(gp, num_episodes=2), []
    for _ in range(3):
        guard.begin()
        guard.end(*episode(gp, generator))
        seen.append(guard.sums[-1])
    assert len(guard.sums) == 2
    assert all(torch.equal(a, b) for a, b in zip(guard.sums, seen[1:], strict=True))
