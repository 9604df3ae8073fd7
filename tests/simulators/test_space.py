from __future__ import annotations

import copy
import math
import pickle

import pytest
import torch

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.space import ActionSpace, StateSpace, wrap_angle

DTYPES = [torch.float32, torch.float64]


def pose_space() -> StateSpace:
    """x, one angle, one quaternion, speed."""
    names = ["x", "yaw", "qw", "qx", "qy", "qz", "speed"]
    return StateSpace(names, [-1, -math.pi, -1, -1, -1, -1, -5], [1, math.pi, 1, 1, 1, 1, 5], [1], [2])


@pytest.mark.parametrize("dtype", DTYPES)
def test_wrap_angle_lands_in_the_half_open_turn_and_is_the_same_rotation(dtype: torch.dtype) -> None:
    angle = torch.linspace(-50.0, 50.0, 10_001, dtype=dtype)
    wrapped = wrap_angle(angle)
    assert wrapped.dtype == dtype
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    assert (wrapped >= -math.pi - tolerance).all()
    assert (wrapped < math.pi + tolerance).all()
    torch.testing.assert_close(torch.polar(torch.ones_like(angle), wrapped), torch.polar(torch.ones_like(angle), angle))


def test_wrap_angle_keeps_every_bit_inside_and_maps_pi_to_minus_pi() -> None:
    inside = torch.empty(1000, dtype=torch.float64).uniform_(-3.14, 3.14, generator=torch.Generator().manual_seed(0))
    assert torch.equal(wrap_angle(inside), inside)
    ends = torch.tensor([math.pi, -math.pi], dtype=torch.float64)
    assert wrap_angle(ends).tolist() == [-math.pi, -math.pi]


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_wrap_touches_angles_and_quaternions_only(dtype: torch.dtype, batch: tuple[int, ...]) -> None:
    state = 10.0 * torch.randn(*batch, 7, generator=torch.Generator().manual_seed(1), dtype=dtype)
    wrapped = pose_space().wrap(state)
    assert (wrapped.shape, wrapped.dtype) == (state.shape, dtype)
    assert torch.equal(wrapped[..., [0, 6]], state[..., [0, 6]])
    torch.testing.assert_close(torch.sin(wrapped[..., 1]), torch.sin(state[..., 1]), atol=1e-5, rtol=0)
    assert wrapped[..., 1].abs().max() <= math.pi + 1e-5
    torch.testing.assert_close(wrapped[..., 2:6], torch.nn.functional.normalize(state[..., 2:6], dim=-1))


def test_wrap_makes_a_zero_quaternion_the_identity() -> None:
    assert pose_space().wrap(torch.zeros(7))[2:6].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_wrap_passes_gradients() -> None:
    state = torch.randn(3, 7, dtype=torch.float64, generator=torch.Generator().manual_seed(2), requires_grad=True)
    assert torch.autograd.gradcheck(pose_space().wrap, (state,))


def test_wrap_spoils_no_neighbour_of_a_nan() -> None:
    state = torch.zeros(2, 7, dtype=torch.float64)
    state[0] = math.nan
    wrapped = pose_space().wrap(state)
    assert wrapped[0].isnan().all()
    assert wrapped[1].isfinite().all()


def test_difference_goes_the_short_way_round() -> None:
    space = StateSpace(["theta", "speed"], -10.0, 10.0, angles=[0])
    a, b = torch.tensor([3.1, 2.0]), torch.tensor([-3.1, -1.0])
    torch.testing.assert_close(space.difference(a, b), torch.tensor([6.2 - 2 * math.pi, 3.0]))
    torch.testing.assert_close(space.difference(b, a), torch.tensor([2 * math.pi - 6.2, -3.0]))
    torch.testing.assert_close(space.unwrap(a, b), torch.tensor([3.1 - 2 * math.pi, 2.0]))


def test_difference_of_a_quaternion_and_its_negative_is_zero_and_batches_broadcast() -> None:
    state = pose_space().sample((5,), torch.Generator().manual_seed(3))
    negative = state.clone()
    negative[:, 2:6] *= -1
    assert pose_space().difference(negative, state).abs().max() == 0
    assert pose_space().difference(state, state[0]).shape == (5, 7)
    torch.testing.assert_close(pose_space().unwrap(negative, state), state)


@pytest.mark.parametrize("shape", [(), (6,), (2, 3)])
def test_sample_stays_in_bounds_with_unit_quaternions_and_repeats_from_a_seed(shape: tuple[int, ...]) -> None:
    space = pose_space()
    first, second = (space.sample(shape, torch.Generator().manual_seed(4)) for _ in range(2))
    assert torch.equal(first, second)
    assert first.shape == (*shape, 7)
    assert first.dtype == torch.float64
    assert (first >= space.low).all()
    assert (first <= space.high).all()
    torch.testing.assert_close(first[..., 2:6].norm(dim=-1), torch.ones(shape, dtype=torch.float64))


def test_sample_is_uniform() -> None:
    space = ActionSpace(["a", "b"], [-2.0, 0.0], [2.0, 1.0])
    points = space.sample((20_000,), torch.Generator().manual_seed(5))
    torch.testing.assert_close(points.mean(0), torch.tensor([0.0, 0.5], dtype=torch.float64), atol=0.03, rtol=0)
    torch.testing.assert_close(points.std(0), (space.high - space.low) / 12**0.5, atol=0.02, rtol=0)


def test_grid_of_a_straight_line_has_both_ends_and_of_a_circle_one() -> None:
    space = StateSpace(["theta", "speed"], [-math.pi, -8.0], [math.pi, 8.0], angles=[0])
    points = space.grid([4, 3])
    assert points.shape == (12, 2)
    torch.testing.assert_close(points[::3, 0], torch.tensor([-1.0, -0.5, 0.0, 0.5], dtype=torch.float64) * math.pi)
    assert points[:3, 1].tolist() == [-8.0, 0.0, 8.0]
    part = StateSpace(["theta"], -1.0, 1.0, angles=[0])
    assert part.grid(3)[:, 0].tolist() == [-1.0, 0.0, 1.0]
    assert ActionSpace(["u"], -2.0, 2.0).grid(5)[:, 0].tolist() == [-2.0, -1.0, 0.0, 1.0, 2.0]


@pytest.mark.parametrize("dtype", DTYPES)
def test_clamp_keeps_the_dtype(dtype: torch.dtype) -> None:
    space = ActionSpace(["a", "b"], [-1.0, -math.inf], [1.0, 3.0])
    clamped = space.clamp(torch.tensor([[5.0, 5.0], [-5.0, -5.0]], dtype=dtype))
    assert clamped.dtype == dtype
    assert clamped.tolist() == [[1.0, 3.0], [-1.0, -5.0]]


def test_a_space_without_dimensions_works() -> None:
    space = ActionSpace([], 0.0, 0.0)
    assert space.dim == 0
    assert space.sample((3,), torch.Generator().manual_seed(0)).shape == (3, 0)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda space: pickle.loads(pickle.dumps(space))])
def test_copies_behave_alike(copied) -> None:
    space = pose_space()
    twin = copied(space)
    state = torch.randn(4, 7, generator=torch.Generator().manual_seed(6))
    assert torch.equal(twin.wrap(state), space.wrap(state))
    assert twin.names == space.names


def test_state_dict_holds_the_bounds() -> None:
    space, other = ActionSpace(["u"], -2.0, 2.0), ActionSpace(["u"], 0.0, 1.0)
    assert set(space.state_dict()) == {"low", "high"}
    other.load_state_dict(space.state_dict())
    assert (other.low.item(), other.high.item()) == (-2.0, 2.0)
    assert set(pose_space().state_dict()) == {"low", "high"}


def test_repr_names_the_dimensions() -> None:
    assert "['torque'], low=[-2.0], high=[2.0]" in repr(ActionSpace(["torque"], -2.0, 2.0))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ActionSpace(["a", "a"], 0.0, 1.0), "one distinct name"),
        (lambda: ActionSpace(["a", "b"], [0.0, 1.0, 2.0], 3.0), r"`low` as one number or as 2 numbers.*\(3,\)"),
        (lambda: ActionSpace(["a", "b"], [0.0, 2.0], 1.0), r"\[2.0, 1.0\] for `b`"),
        (lambda: ActionSpace(["a"], math.nan, 1.0), "low <= high"),
        (lambda: StateSpace(["a"], 0.0, 1.0, angles=[1]), r"indices in \[0, 1\)"),
        (lambda: StateSpace(["a"], 0.0, 1.0, angles=[-1]), r"indices in \[0, 1\)"),
        (lambda: StateSpace(list("abcd"), 0.0, 1.0, angles=[3], quaternions=[0]), "distinct indices"),
        (lambda: StateSpace(["a", "b"], [-math.inf, 0.0], 1.0).sample((2,)), r"StateSpace.sample.*\['a'\]"),
        (lambda: ActionSpace(["a"], 0.0, math.inf).grid(2), r"ActionSpace.grid.*\['a'\]"),
        (lambda: ActionSpace(["a"], 0.0, 1.0).grid(0), "found 0"),
        (lambda: ActionSpace(["a"], 0.0, 1.0).grid([2, 2]), "or 1 of them"),
        (lambda: pose_space().grid(2), "without quaternions"),
    ],
)
def test_errors_say_what_is_wrong(build, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        build()
