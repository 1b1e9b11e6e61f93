"""Statistics of responses: planted noise, sparse reflections and decays are told as such."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F64
from studies.realism import BAND_HZ, banded, contrast, kurtosis, reverberation_s, spread_db

RATE_HZ = 48_000


def decaying_noise(t60_s: float, count: int = 40) -> F64:
    t_s = np.arange(round(0.12 * RATE_HZ)) / RATE_HZ
    noise = np.random.default_rng(0).standard_normal((count, len(t_s)))
    return np.asarray(noise * 10 ** (-3 * t_s / t60_s))


def test_a_diffuse_field_has_kurtosis_three_and_a_rayleigh_envelope() -> None:
    band = banded(decaying_noise(0.2), RATE_HZ)
    assert kurtosis(band, RATE_HZ) == pytest.approx([2.7] * 3, abs=0.15)  # 3, had it no own part
    assert spread_db(band, RATE_HZ) == pytest.approx([5.4] * 3, abs=0.35)


def test_sparse_reflections_have_more_of_both() -> None:
    noise, generator = decaying_noise(0.2), np.random.default_rng(1)
    band = banded(noise * (generator.uniform(size=noise.shape) < 0.02), RATE_HZ)
    assert min(kurtosis(band, RATE_HZ)) > 3.5
    assert min(spread_db(band, RATE_HZ)) > 6.5


@pytest.mark.parametrize("t60_s", [0.1, 0.15, 0.2])
def test_a_decay_is_told_even_where_it_is_cut(t60_s: float) -> None:
    assert reverberation_s(banded(decaying_noise(t60_s), RATE_HZ), RATE_HZ) == pytest.approx(
        t60_s, rel=0.1
    )


def test_only_the_band_counts() -> None:
    t_s = np.arange(3000) / RATE_HZ
    within, below = (np.sin(2 * np.pi * hz * t_s)[None] for hz in (17_500.0, 12_000.0))
    assert BAND_HZ[0] > 12_000
    assert np.abs(banded(within, RATE_HZ)[0, 1000:1400]).max() == pytest.approx(1.0, abs=0.05)
    assert np.abs(banded(below, RATE_HZ)[0, 1000:1400]).max() < 1e-3


def test_contrast_is_one_for_the_same_and_nothing_for_others() -> None:
    features = np.random.default_rng(2).standard_normal((60, 200)) + 0.5
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    assert contrast(features, features) == pytest.approx(1.0)
    assert contrast(features, np.roll(features, 1, axis=0)) == pytest.approx(0.0, abs=0.05)
