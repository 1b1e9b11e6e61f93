"""A cover over a port: it takes what it was told, and more of the shorter waves."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ
from elfslam.world.port_occlusion import port_occlusion
from elfslam.world.pulses import C64


def some_envelopes(count: int) -> C64:
    parts = np.random.default_rng(0).standard_normal((2, count, BAND_BINS))
    return (parts[0] + 1j * parts[1]).astype(np.complex64)


def loss_db(before: C64, after: C64, frequency_hz: float) -> F64:
    at = round((frequency_hz - BAND_LOW_HZ) / BIN_HZ)
    spectra = [np.fft.fftshift(np.fft.fft(rows, axis=1), axes=1)[:, at] for rows in (before, after)]
    return np.asarray(20 * np.log10(np.abs(spectra[0] / spectra[1])))


@pytest.mark.parametrize(("frequency_hz", "share"), [(15e3, 0.7), (17.5e3, 1.0), (20e3, 1.3)])
def test_a_cover_takes_its_decibels_and_more_at_the_upper_end(
    frequency_hz: float, share: float
) -> None:
    sound, covered_db = some_envelopes(3), np.array([6.0, 0.0, 20.0])
    taken = loss_db(sound, port_occlusion(sound, covered_db), frequency_hz)
    assert taken == pytest.approx(share * covered_db, abs=1e-3)


def test_what_is_open_keeps_every_byte() -> None:
    sound = some_envelopes(3)
    assert port_occlusion(sound, np.zeros(3)) is sound
    half = port_occlusion(sound, np.array([0.0, 9.0, 0.0]))
    assert half[[0, 2]].tobytes() == sound[[0, 2]].tobytes()
    assert half.dtype == np.complex64
    assert np.abs(half[1] - sound[1]).max() > 0.1


def test_a_cover_delays_nothing() -> None:
    """An impulse stays where it is."""
    impulse = np.zeros((1, BAND_BINS), np.complex64)
    impulse[0, 100] = 1.0
    heard = np.abs(port_occlusion(impulse, np.full(1, 20.0))[0])
    assert heard.argmax() == 100
    assert heard[100] == pytest.approx(0.1, rel=0.2)
    assert np.delete(heard, range(97, 104)).max() < 0.1 * heard[100]
