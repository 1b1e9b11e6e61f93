"""The excitation: a soft near-inaudible sweep, played once per period."""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.parameters import parameter
from elfslam.base.values import Chirp

ACCEPTED_RATES_HZ = (44_100, 48_000)
"""10 ms and 100 ms are whole samples at both."""


@dataclass(frozen=True)
class ChirpParameters:
    """What is played (paper section 3, excitation signal)."""

    kind: str = parameter("chirp", "", "excitation: chirp (logarithmic) or tone")
    band_low_hz: float = parameter(15_000.0, "Hz", "lower end of the band", 1_000.0, 21_000.0)
    band_high_hz: float = parameter(20_000.0, "Hz", "upper end of the band", 2_000.0, 22_000.0)
    duration_s: float = parameter(0.010, "s", "length of one excitation", 0.001, 0.05)
    period_s: float = parameter(0.100, "s", "time from one excitation to the next", 0.08, 1.0)
    fade_s: float = parameter(
        0.001, "s", "raised-cosine fade at both ends, against clicks", 0.0, 0.025
    )


def make_chirp(parameters: ChirpParameters, rate_hz: int) -> Chirp:
    """One excitation at `rate_hz`, peak amplitude 1.

    Raises InputError for a rate other than 44.1 or 48 kHz, ParameterError for an unknown kind
    or for parameters that contradict each other.
    """
    check_rate(rate_hz)
    if 2 * parameters.fade_s > parameters.duration_s:
        raise ParameterError(
            f"chirp.fade_s: wanted at most half of duration_s ({parameters.duration_s:g} s), "
            f"got {parameters.fade_s:g}; set both"
        )
    if not 0 < parameters.band_low_hz < parameters.band_high_hz:
        raise ParameterError(
            f"chirp.band_high_hz: wanted more than band_low_hz ({parameters.band_low_hz:g}), "
            f"got {parameters.band_high_hz:g}; set both"
        )
    t_s = np.arange(round(parameters.duration_s * rate_hz)) / rate_hz
    phase_rad = _phase_rad(parameters, t_s)
    samples = (np.sin(phase_rad) * _fade(t_s, parameters)).astype(np.float32)
    band_hz = np.array([parameters.band_low_hz, parameters.band_high_hz])
    return Chirp(samples, rate_hz, parameters.period_s, band_hz)


def describe_chirp(played: ChirpParameters | None = None) -> dict[str, object]:
    """What was played, by default the pipeline's own excitation, as recording.json says it."""
    played = played or ChirpParameters()
    return {
        "kind": played.kind,
        "band_hz": [played.band_low_hz, played.band_high_hz],
        "duration_s": played.duration_s,
        "period_s": played.period_s,
    }


def check_rate(rate_hz: int) -> None:
    """Refuse a sampling rate at which the band or the period does not fit."""
    if rate_hz not in ACCEPTED_RATES_HZ:
        raise InputError(
            f"audio rate: wanted 44100 or 48000 Hz, got {rate_hz}; record again at one of the two"
        )


def _phase_rad(parameters: ChirpParameters, t_s: F64) -> F64:
    low_hz, high_hz = parameters.band_low_hz, parameters.band_high_hz
    if parameters.kind == "chirp":
        ratio, duration_s = high_hz / low_hz, parameters.duration_s
        turns = low_hz * duration_s / np.log(ratio) * (ratio ** (t_s / duration_s) - 1.0)
    elif parameters.kind == "tone":
        turns = high_hz * t_s
    else:
        raise ParameterError(
            f"chirp.kind: wanted chirp or tone, got {parameters.kind!r}; choose one"
        )
    return np.asarray(2 * np.pi * turns)


def _fade(t_s: F64, parameters: ChirpParameters) -> F64:
    if parameters.fade_s == 0:
        return np.ones_like(t_s)
    edge_s = np.minimum(t_s, t_s[-1] - t_s)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.minimum(edge_s / parameters.fade_s, 1.0)))
