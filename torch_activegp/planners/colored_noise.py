"""Gaussian noise whose power falls with frequency: smooth action sequences for the planner."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError


class ColoredNoise(nn.Module):
    """Stationary Gaussian noise with a power spectrum proportional to ``1 / f ** beta`` and unit variance.

    White noise is filtered in the frequency domain, so that every step has variance 1 exactly, whatever ``beta``.
    The constant part of a sequence has the power of the lowest frequency, ``1 / num_steps``. ``beta`` 0 is white,
    1 pink, 2 red: the larger, the slower the sequence moves.

    Numbers are drawn on the generator's device and then moved to the module's, so a generator on the CPU gives
    the same noise on every device. The state of the generator is part of the ``state_dict``.

    Args:
        num_steps: length of a sequence.
        beta: exponent of the spectrum, finite and not negative.
        generator: source of all draws; a CPU generator with seed 0 when None.
        dtype: floating type of the noise.

    Raises:
        ConfigurationError: ``num_steps`` is not positive, or ``beta`` is negative or not finite.

    Reference:
        Pinneri et al. 2020, *Sample-efficient Cross-Entropy Method for Real-time Planning*, section 3.1,
        arXiv 2008.06389.

    Example:
        >>> noise = ColoredNoise(10, beta=2.0, generator=torch.Generator().manual_seed(0))
        >>> noise((50, 3)).shape
        torch.Size([50, 3, 10])
    """

    gain: Tensor

    def __init__(
        self,
        num_steps: int,
        beta: float = 2.0,
        generator: torch.Generator | None = None,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        if num_steps < 1:
            raise ConfigurationError(f"`num_steps` must be at least 1, found {num_steps}.")
        if not (math.isfinite(beta) and beta >= 0.0):
            raise ConfigurationError(f"`beta` must be finite and not negative, found {beta}; 0 is white noise.")
        self.num_steps = num_steps
        self.beta = beta
        self.generator = torch.Generator().manual_seed(0) if generator is None else generator
        self.register_buffer("gain", _unit_variance_gain(num_steps, beta).to(dtype), persistent=False)

    def forward(self, shape: Sequence[int]) -> Tensor:
        """Draw sequences that are independent of each other.

        Args:
            shape: shape of the block of sequences.

        Returns:
            Noise, ``(*shape, num_steps)``: correlated along the last dimension only.
        """
        gain = self.gain
        white = torch.randn(
            (*shape, self.num_steps), generator=self.generator, dtype=gain.dtype, device=self.generator.device
        )
        return torch.fft.irfft(torch.fft.rfft(white.to(gain.device)) * gain, n=self.num_steps)

    def get_extra_state(self) -> Tensor:
        """Return the generator's state, so that a restored module draws the same numbers."""
        return self.generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Put the generator back into a state from ``get_extra_state``."""
        self.generator.set_state(state.cpu())


def _unit_variance_gain(num_steps: int, beta: float) -> Tensor:
    """Return the factor of each frequency of a real FFT, ``(num_steps // 2 + 1,)``."""
    index = torch.arange(num_steps // 2 + 1, dtype=torch.float64)
    power = index.clamp(min=1.0) ** -beta
    multiplicity = torch.where((index == 0) | (2 * index == num_steps), 1.0, 2.0)
    return (power * num_steps / (multiplicity * power).sum()).sqrt()
