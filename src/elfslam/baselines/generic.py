"""Generic features: what an echo is compared by when nothing was learned about places.

Baselines of the ELF in the paper, section 4: the raw trace, its power spectral density, its
spectrogram, and principal components of the spectrogram. Each is an `Encoder` of the pipeline.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.stages.feature import Encoder, spectrogram

DECIMATION = 3
"""At 14.7 kHz the band of the chirp fills one Nyquist zone, 14.7 to 22.05 kHz: nothing of it
folds onto itself."""
PSD_WINDOW_SAMPLES = 588
"""75 Hz from bin to bin; windows overlap by half (Welch 1967)."""
PSD_BAND_HZ = (15_000.0, 20_250.0)
COMPONENTS = 32
LOG_FLOOR = 0.02
"""Of the mean magnitude, added before the logarithm: as the learned encoder has it."""
STILL = 0.75
"""Of spectrograms (plain, root, log) 0.7 to 1.0 are below walking, in rooms 0.1 to 0.5 standing."""

SUCCESSIVE = {
    "spectrogram without mean": 0.2,
    "root spectrogram": 0.18,
    "log spectrogram": 0.13,
}
"""The least in diffuse rooms and halls by quiet phones; those of raw samples have nothing."""

Description = Callable[[F32], F32]
"""Rows (n, d) of any length that describe traces (n, 2352), each by itself."""


@dataclass(frozen=True)
class GenericEncoder:
    """A description of echo traces, scaled to unit rows."""

    identity: str
    describe: Description
    still: float = STILL
    successive: float = 0.0

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, d) from aligned traces (n, 2352); silence gives zeros."""
        return unit_rows(self.describe(samples))


def generic_encoders() -> Mapping[str, Encoder]:
    """The encoders that need no fitting, by the name of the feature."""
    described: dict[str, Description] = {
        "raw samples": decimated,
        "PSD": power_spectral_density,
        "spectrogram": flat_spectrogram,
        "spectrogram without mean": centred_spectrogram,
        "root spectrogram": root_spectrogram,
        "log spectrogram": log_spectrogram,
    }
    return {
        name: GenericEncoder(
            f"{name.replace(' ', '-')}-1", describe, successive=SUCCESSIVE.get(name, 0.0)
        )
        for name, describe in described.items()
    }


def principal_encoder(echoes: F32) -> Encoder:
    """Spectrograms on the principal components of those of `echoes` (m, 2352), which are frozen.

    Raises InputError for fewer echoes than components.
    """
    if len(echoes) <= COMPONENTS:
        raise InputError(
            f"principal components: wanted more than {COMPONENTS} echoes to fit them, "
            f"got {len(echoes)}; pass more"
        )
    known = unit_rows(flat_spectrogram(echoes))
    mean = known.mean(axis=0)
    axes = np.linalg.svd(known - mean, full_matrices=False)[2][:COMPONENTS].T
    digest = hashlib.sha256(mean.tobytes() + axes.tobytes()).hexdigest()[:16]
    return GenericEncoder(
        f"principal-{digest}", lambda samples: (unit_rows(flat_spectrogram(samples)) - mean) @ axes
    )


def unit_rows(rows: F32) -> F32:
    """Rows of length 1; zeros stay zeros."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.maximum(length, 1e-20), dtype=np.float32)


def decimated(samples: F32) -> F32:
    """Every third sample (n, 784)."""
    return samples[:, ::DECIMATION]


def power_spectral_density(samples: F32) -> F32:
    """Power (n, 71) from 15 to 20.25 kHz, 75 Hz apart, averaged over Hann windows."""
    frames = np.lib.stride_tricks.sliding_window_view(samples, PSD_WINDOW_SAMPLES, axis=1)
    window = np.hanning(PSD_WINDOW_SAMPLES + 1)[:-1].astype(np.float32)
    spectrum = np.fft.rfft(frames[:, :: PSD_WINDOW_SAMPLES // 2] * window, axis=2)
    low, high = (round(hz * PSD_WINDOW_SAMPLES / ECHO_RATE_HZ) for hz in PSD_BAND_HZ)
    power = np.abs(spectrum[:, :, low : high + 1]) ** 2
    return np.asarray(power.mean(axis=1), dtype=np.float32)


def flat_spectrogram(samples: F32) -> F32:
    """Magnitudes (n, 576) of the 12x48 spectrogram."""
    image = spectrogram(samples)
    return image.reshape(len(image), image.shape[1] * image.shape[2])


def centred_spectrogram(samples: F32) -> F32:
    """The same without the mean of each echo, which lifts all cosines towards 1."""
    flat = flat_spectrogram(samples)
    return np.asarray(flat - flat.mean(axis=1, keepdims=True))


def root_spectrogram(samples: F32) -> F32:
    """Square roots of the magnitudes, without their mean: late and early sound count evenly."""
    root = np.sqrt(flat_spectrogram(samples))
    return np.asarray(root - root.mean(axis=1, keepdims=True))


def log_spectrogram(samples: F32) -> F32:
    """Logarithms of the magnitudes, without their mean: loudness counts as the ear has it."""
    flat = flat_spectrogram(samples)
    floor = LOG_FLOOR * flat.mean(axis=1, keepdims=True)
    level = np.log1p(flat / np.maximum(floor, 1e-20))
    return np.asarray(level - level.mean(axis=1, keepdims=True))
