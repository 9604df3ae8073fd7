"""The planner's memory: shifts, batch shapes, state."""

from __future__ import annotations

import pickle

import pytest
import torch

from torch_activegp.errors import CheckpointError
from torch_activegp.planners import WarmStart


def filled(batch: tuple[int, ...] = ()) -> WarmStart:
    memory = WarmStart(horizon=3, action_dim=2)
    mean = torch.arange(6.0, dtype=torch.float64).view(3, 2).expand(*batch, 3, 2)
    memory.store(mean, torch.stack([mean, 10 + mean], dim=-3))
    return memory


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_mean_is_shifted_and_its_last_action_repeated(batch):
    expected = torch.tensor([[2.0, 3.0], [4.0, 5.0], [4.0, 5.0]], dtype=torch.float64)
    assert torch.equal(filled(batch).shifted_mean(), expected.expand(*batch, 3, 2))


@pytest.mark.parametrize("batch", [(), (4,)])
def test_elites_are_shifted_and_end_in_a_fresh_action(batch):
    fresh = torch.full((*batch, 2, 3, 2), 7.0, dtype=torch.float64)
    expected = torch.tensor(
        [[[2.0, 3.0], [4.0, 5.0], [7.0, 7.0]], [[12.0, 13.0], [14.0, 15.0], [7.0, 7.0]]], dtype=torch.float64
    )
    assert torch.equal(filled(batch).shifted_elites(fresh), expected.expand(*batch, 2, 3, 2))


def test_fits_only_the_batch_shape_it_was_filled_with():
    memory = filled((4,))
    assert memory.fits(torch.Size([4]))
    assert not memory.fits(torch.Size([])) and not memory.fits(torch.Size([5]))
    memory.forget()
    assert not memory.fits(torch.Size([4]))


def test_an_empty_memory_says_so():
    with pytest.raises(RuntimeError, match="memory is empty"):
        WarmStart(3, 2).shifted_mean()


@pytest.mark.parametrize("source", [filled((4,)), WarmStart(3, 2)])
def test_state_dict_and_pickle_round_trip(source):
    other = filled()
    other.load_state_dict(source.state_dict())
    for twin in (other, pickle.loads(pickle.dumps(source))):
        assert twin.fits(torch.Size([4])) == source.fits(torch.Size([4]))
        if source.mean is not None:
            assert torch.equal(twin.mean, source.mean) and torch.equal(twin.elites, source.elites)


def test_the_memory_follows_the_module():
    memory = filled().to(torch.float32)
    assert memory.mean.dtype == memory.elites.dtype == torch.float32


def test_a_memory_of_another_horizon_is_refused():
    with pytest.raises(CheckpointError, match=r"= \(3, 2\), this planner has \(5, 2\)"):
        WarmStart(5, 2).load_state_dict(filled().state_dict())
