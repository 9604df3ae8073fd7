"""State and action spaces: names, bounds, and which dimensions live on a circle or are unit quaternions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError

_TURN = 2.0 * math.pi
Bound = float | Sequence[float] | Tensor


def wrap_angle(angle: Tensor) -> Tensor:
    """Maps angles into [-pi, pi); values already inside keep every bit.

    Args:
        angle: any shape, rad.

    Returns:
        The same angle on the circle, of the same shape and dtype, rad. An infinite angle becomes NaN.
    """
    turns = torch.mul(angle, 1.0 / _TURN).add_(0.5).floor_()
    return torch.sub(angle, turns, alpha=_TURN)


class _Box(nn.Module):
    """Named dimensions with a lower and an upper bound each; infinite bounds are allowed."""

    low: Tensor
    high: Tensor

    def __init__(self, names: Sequence[str], low: Bound, high: Bound) -> None:
        super().__init__()
        self.names = tuple(names)
        kind, dim = type(self).__name__, len(self.names)
        if len(set(self.names)) != dim:
            raise ConfigurationError(f"{kind}: wanted one distinct name a dimension, found {list(self.names)}.")
        for name, bound in (("low", low), ("high", high)):
            value = torch.as_tensor(bound, dtype=torch.float64)
            if value.shape not in ((), (dim,)):
                raise ConfigurationError(
                    f"{kind}: wanted `{name}` as one number or as {dim} numbers (one for each of {list(self.names)}), "
                    f"found shape {tuple(value.shape)}."
                )
            self.register_buffer(name, value.detach().expand(dim).clone())
        bad = ~(self.low <= self.high)
        if bad.any():
            index = int(bad.nonzero()[0])
            raise ConfigurationError(
                f"{kind}: wanted low <= high, found [{float(self.low[index])}, {float(self.high[index])}] "
                f"for `{self.names[index]}`."
            )

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return len(self.names)

    def extra_repr(self) -> str:
        """Names and bounds, for ``print``."""
        return f"names={list(self.names)}, low={self.low.tolist()}, high={self.high.tolist()}"

    def sample(self, shape: Sequence[int] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draws points uniformly between the bounds.

        Args:
            shape: batch shape.
            generator: source of chance, on any device.

        Returns:
            ``(*shape, dim)``, in the dtype and on the device of the bounds.

        Raises:
            ConfigurationError: a dimension has an infinite bound.
        """
        self._require_finite("sample")
        device = self.low.device if generator is None else generator.device
        unit = torch.rand(*shape, self.dim, generator=generator, dtype=self.low.dtype, device=device)
        return torch.lerp(self.low, self.high, unit.to(self.low.device))

    def grid(self, points_per_dim: int | Sequence[int]) -> Tensor:
        """Lays a regular grid between the bounds, both ends included.

        Args:
            points_per_dim: number of points along each dimension, one for all or one each.

        Returns:
            ``(product of points_per_dim, dim)``; the last dimension varies fastest.

        Raises:
            ConfigurationError: a dimension has an infinite bound, or ``points_per_dim`` does not fit.
        """
        self._require_finite("grid")
        counts = [points_per_dim] * self.dim if isinstance(points_per_dim, int) else list(points_per_dim)
        if len(counts) != self.dim or min(counts, default=1) < 1:
            raise ConfigurationError(
                f"grid: wanted one number of points >= 1, or {self.dim} of them, found {points_per_dim}."
            )
        axes = [self._axis(index, count) for index, count in enumerate(counts)]
        return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1).reshape(-1, self.dim)

    def _axis(self, index: int, count: int) -> Tensor:
        low, high = self.low[index], self.high[index]
        return torch.lerp(low, high, torch.linspace(0.0, 1.0, count, dtype=low.dtype, device=low.device))

    def _require_finite(self, method: str) -> None:
        finite = self.low.isfinite() & self.high.isfinite()
        if not finite.all():
            names = [name for name, ok in zip(self.names, finite.tolist(), strict=True) if not ok]
            raise ConfigurationError(
                f"{type(self).__name__}.{method} wants finite bounds, found infinite ones for {names}. "
                "Give `low` and `high` for these dimensions."
            )


class ActionSpace(_Box):
    """The actions that a machine accepts.

    Args:
        names: one name a dimension.
        low: lower bounds, one number or ``(m,)``; ``-inf`` for none.
        high: upper bounds, one number or ``(m,)``; ``inf`` for none.

    Raises:
        ConfigurationError: names repeat, bounds do not fit the names, or ``low > high``.

    Example:
        >>> ActionSpace(["torque"], -2.0, 2.0).clamp(torch.tensor([[3.0]])).item()
        2.0
    """

    def clamp(self, action: Tensor) -> Tensor:
        """Clips actions ``(..., m)`` into the bounds; dtype and shape stay."""
        return torch.clamp(action, self.low.to(action), self.high.to(action))


class StateSpace(_Box):
    """The states of a machine, with the dimensions that are not a straight line.

    Args:
        names: one name a dimension.
        low: lower bounds, one number or ``(d,)``; ``-inf`` for none.
        high: upper bounds, one number or ``(d,)``; ``inf`` for none.
        angles: indices of the dimensions on the circle, rad.
        quaternions: index of the first entry of each unit quaternion (w, x, y, z).

    Raises:
        ConfigurationError: names repeat, bounds do not fit the names, ``low > high``, or an index is out of range or
            used twice.

    Example:
        >>> space = StateSpace(["theta", "speed"], [-math.pi, -8.0], [math.pi, 8.0], angles=[0])
        >>> space.difference(torch.tensor([3.0, 1.0]), torch.tensor([-3.0, 0.0]))
        tensor([-0.2832,  1.0000])
    """

    _turns: Tensor
    _half: Tensor
    _quaternion_index: Tensor

    def __init__(
        self, names: Sequence[str], low: Bound, high: Bound, angles: Sequence[int] = (), quaternions: Sequence[int] = ()
    ) -> None:
        super().__init__(names, low, high)
        self.angles = tuple(int(index) for index in angles)
        self.quaternions = tuple(int(index) for index in quaternions)
        blocks = [first + offset for first in self.quaternions for offset in range(4)]
        used = [*self.angles, *blocks]
        if len(set(used)) != len(used) or not all(0 <= index < self.dim for index in used):
            raise ConfigurationError(
                f"StateSpace: wanted `angles` and `quaternions` (four entries each) as distinct indices in "
                f"[0, {self.dim}), found angles={list(self.angles)}, quaternions={list(self.quaternions)}."
            )
        on_circle = torch.zeros(self.dim, dtype=self.low.dtype)
        on_circle[list(self.angles)] = 1.0
        self.register_buffer("_turns", on_circle / _TURN, persistent=False)
        self.register_buffer("_half", on_circle / 2.0, persistent=False)
        self.register_buffer("_quaternion_index", torch.tensor(blocks, dtype=torch.long), persistent=False)

    def wrap(self, state: Tensor) -> Tensor:
        """Brings angles into [-pi, pi) and quaternions to unit length; ``(..., d)`` to ``(..., d)``.

        A quaternion of zero length becomes the identity, as in MuJoCo.
        """
        return self._normalize_quaternions(self._wrap_angles(state))

    def difference(self, a: Tensor, b: Tensor) -> Tensor:
        """The change from ``b`` to ``a``, ``(..., d)``: angles the short way round, quaternions of like sign.

        A unit quaternion and its negative are the same rotation; the sign of ``a`` is chosen to agree with ``b``.
        """
        if self.quaternions:
            a, b = torch.broadcast_tensors(a, b)
            pairs = self._quaternions_of(a), self._quaternions_of(b)
            opposite = (pairs[0] * pairs[1]).sum(-1, keepdim=True) < 0
            a = self._with_quaternions(a, torch.where(opposite, -pairs[0], pairs[0]))
        return self._wrap_angles(a - b)

    def unwrap(self, state: Tensor, reference: Tensor) -> Tensor:
        """The representative of ``state`` nearest to ``reference``, ``(..., d)``: no jumps by a turn between them."""
        return reference + self.difference(state, reference)

    def sample(self, shape: Sequence[int] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draws states uniformly between the bounds; rotations uniformly over all rotations.

        Args:
            shape: batch shape.
            generator: source of chance, on any device.

        Returns:
            ``(*shape, d)``, in the dtype and on the device of the bounds.

        Raises:
            ConfigurationError: a dimension has an infinite bound.
        """
        state = super().sample(shape, generator)
        if not self.quaternions:
            return state
        device = state.device if generator is None else generator.device
        size = (*shape, len(self.quaternions), 4)
        normal = torch.randn(size, generator=generator, dtype=state.dtype, device=device)
        return self._normalize_quaternions(self._with_quaternions(state, normal.to(state.device)))

    def grid(self, points_per_dim: int | Sequence[int]) -> Tensor:
        """Lays a regular grid between the bounds, both ends included, save for an angle over a full turn.

        There the two ends are one point, so the upper one is left out.

        Args:
            points_per_dim: number of points along each dimension, one for all or one each.

        Returns:
            ``(product of points_per_dim, d)``; the last dimension varies fastest.

        Raises:
            ConfigurationError: a dimension has an infinite bound, ``points_per_dim`` does not fit, or the space holds
                quaternions, which no box-shaped grid covers.
        """
        if self.quaternions:
            raise ConfigurationError("grid wants a space without quaternions; draw states with `sample` instead.")
        return super().grid(points_per_dim)

    def _axis(self, index: int, count: int) -> Tensor:
        full_turn = bool(self.high[index] - self.low[index] > _TURN - 1e-5)
        if index in self.angles and full_turn:
            return super()._axis(index, count + 1)[:-1]
        return super()._axis(index, count)

    def _wrap_angles(self, state: Tensor) -> Tensor:
        if not self.angles:
            return state
        turns = torch.addcmul(self._half.to(state), state, self._turns.to(state)).floor_()
        return torch.sub(state, turns, alpha=_TURN)

    def _quaternions_of(self, state: Tensor) -> Tensor:
        return state.index_select(-1, self._quaternion_index).unflatten(-1, (-1, 4))

    def _with_quaternions(self, state: Tensor, quaternion: Tensor) -> Tensor:
        return state.index_copy(-1, self._quaternion_index, quaternion.flatten(-2))

    def _normalize_quaternions(self, state: Tensor) -> Tensor:
        if not self.quaternions:
            return state
        quaternion = self._quaternions_of(state)
        length = quaternion.norm(dim=-1, keepdim=True)
        identity = quaternion.new_tensor([1.0, 0.0, 0.0, 0.0])
        zero = length == 0
        return self._with_quaternions(state, torch.where(zero, identity, quaternion / torch.where(zero, 1.0, length)))
