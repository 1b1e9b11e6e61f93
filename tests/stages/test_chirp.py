"""The excitation stays in its band, sweeps logarithmically and fits both sampling rates."""

import numpy as np
import numpy.testing as npt
import pytest
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.stages.chirp import ChirpParameters, make_chirp

RATES_HZ = (44_100, 48_000)


def energy_share(samples: F32, rate_hz: int, low_hz: float, high_hz: float) -> float:
    """Share of the energy between two frequencies, by the padded DFT."""
    power = np.abs(np.fft.rfft(samples, 1 << 16)) ** 2
    frequency_hz = np.fft.rfftfreq(1 << 16, 1 / rate_hz)
    inside = (frequency_hz >= low_hz) & (frequency_hz <= high_hz)
    return float(power[inside].sum() / power.sum())


def instantaneous_hz(samples: F32, rate_hz: int) -> F64:
    """Frequency between neighbouring samples, from the phase of the analytic signal."""
    turns = np.unwrap(np.angle(signal.hilbert(samples))) / (2 * np.pi)
    return np.asarray(np.diff(turns) * rate_hz)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_ten_milliseconds_in_the_band_that_repeat_in_whole_samples(rate_hz: int) -> None:
    chirp = make_chirp(ChirpParameters(), rate_hz)
    assert len(chirp.samples) == rate_hz // 100
    assert chirp.period_s * rate_hz == round(chirp.period_s * rate_hz)
    assert chirp.rate_hz == rate_hz
    assert chirp.band_hz.tolist() == [15_000, 20_000]
    assert energy_share(chirp.samples, rate_hz, 15_000, 20_000) >= 0.99
    assert energy_share(chirp.samples, rate_hz, 0, 14_000) < 1e-4, "next to none is audible"


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_the_frequency_rises_logarithmically(rate_hz: int) -> None:
    samples = make_chirp(ChirpParameters(), rate_hz).samples
    t_s = (np.arange(len(samples) - 1) + 0.5) / rate_hz
    wanted_hz = 15_000 * (20 / 15) ** (t_s / 0.010)
    inner = (t_s > 0.002) & (t_s < 0.008)
    error_hz = (instantaneous_hz(samples, rate_hz) - wanted_hz)[inner]
    # A linear sweep would be off by 180 Hz halfway.
    assert abs(error_hz.mean()) < 10
    assert np.abs(signal.savgol_filter(error_hz, 31, 1)).max() < 60


def test_both_rates_sample_the_same_sound() -> None:
    slow, fast = (make_chirp(ChirpParameters(), rate_hz).samples for rate_hz in RATES_HZ)
    npt.assert_allclose(slow[147], fast[160], atol=1e-6)
    npt.assert_allclose(signal.resample(fast, 441)[50:-50], slow[50:-50], atol=0.02)


def test_the_sweep_is_loud_and_faded_at_both_ends() -> None:
    parameters = ChirpParameters()
    samples = np.abs(make_chirp(parameters, 44_100).samples)
    edge = round(parameters.fade_s * 44_100)
    assert 0.99 < samples.max() <= 1.0
    assert samples[0] == samples[-1] == 0.0
    assert samples[: edge // 4].max() < 0.2
    assert samples[-edge // 4 :].max() < 0.2
    unfaded = make_chirp(ChirpParameters(fade_s=0.0), 44_100).samples
    npt.assert_allclose(samples[edge:-edge], np.abs(unfaded[edge:-edge]), atol=1e-4)
    assert np.abs(unfaded[-3:]).max() > 0.5
    assert unfaded[0] == 0.0
    npt.assert_allclose(unfaded[1], np.sin(2 * np.pi * 15_000 / 44_100), atol=0.01)


def test_a_tone_sits_at_the_upper_end_of_the_band() -> None:
    samples = make_chirp(ChirpParameters(kind="tone"), 44_100).samples
    npt.assert_allclose(np.median(instantaneous_hz(samples, 44_100)), 20_000, atol=50)
    assert energy_share(samples, 44_100, 19_800, 20_200) > 0.95


@pytest.mark.parametrize("rate_hz", [8_000, 22_050, 44_099, 96_000])
def test_other_rates_are_refused(rate_hz: int) -> None:
    with pytest.raises(InputError, match=f"wanted 44100 or 48000 Hz, got {rate_hz}; record again"):
        make_chirp(ChirpParameters(), rate_hz)


def test_no_chirp_of_an_unknown_kind_or_of_a_band_that_ends_before_it_begins() -> None:
    upside_down = ChirpParameters(band_low_hz=18_000.0, band_high_hz=16_000.0)
    with pytest.raises(ParameterError, match=r"chirp\.band_high_hz"):
        make_chirp(upside_down, 44_100)
    with pytest.raises(ParameterError, match="wanted chirp or tone, got 'whistle'"):
        make_chirp(ChirpParameters(kind="whistle"), 44_100)
