"""Ringing of loudspeakers and microphones: resonances beside the direct sound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError

C128 = npt.NDArray[np.complex128]
LEAST_Q = 0.5
"""From here on a pair of poles rings."""


@dataclass(frozen=True)
class Resonance:
    """A pair of poles: its frequency, quality factor and gain at its peak beside the direct sound.

    It rings down by exp(-pi `frequency_hz` t / `q`). Raises InputError for what does not ring.
    """

    frequency_hz: float
    q: float
    gain: float

    def __post_init__(self) -> None:
        if not (self.frequency_hz > 0 and LEAST_Q < self.q < np.inf and np.isfinite(self.gain)):
            raise InputError(
                f"resonance: wanted a positive frequency, a q above {LEAST_Q} and a finite gain, "
                f"got {self.frequency_hz} Hz, {self.q} and {self.gain}; correct it"
            )

    @property
    def decay_s(self) -> float:
        """Time in which it falls to 1 / e."""
        return self.q / (np.pi * self.frequency_hz)


def ringing(resonances: Sequence[Resonance], frequency_hz: F64) -> C128:
    """Complex gain (n) of the direct sound, which is 1, and of all resonances at frequencies (n).

    Each adds the band-pass of second order gain (j f fk / q) / (fk^2 - f^2 + j f fk / q): causal,
    and in time a cosine that decays from the first moment on.
    """
    total = np.ones(len(frequency_hz), dtype=np.complex128)
    for mode in resonances:
        damping = 1j * frequency_hz * mode.frequency_hz / mode.q
        total += mode.gain * damping / (mode.frequency_hz**2 - frequency_hz**2 + damping)
    return total
