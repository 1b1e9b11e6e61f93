"""What ordinary phones have beside a response: ringing, lobes, noise, and perhaps a gain control.

No measurement of all of these was found. The ranges are estimates that agree with what is known of
transducers of a centimetre: decays of tenths of a millisecond, lobes of some dB. The noise is such
that in rooms as hard as measured ones echoes of 11 to 64 ms are mostly 18 to 25 dB above the noise
of their band at full volume, as in a measured office (18 dB), and 5 to 11 dB at a fifth of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.world.gain_control import GainControl
from elfslam.world.lobes import Lobes
from elfslam.world.ringing import Resonance, ringing

RESONANCES = (2, 4)
HEARD_HZ = (15_000.0, 20_000.0)
DECAY_S = (0.1e-3, 0.4e-3)
"""Of a resonance to 1 / e; it is 20 dB down after 0.23 to 0.92 ms."""
RESONANCE_GAIN = (0.2, 0.8)
SPEAKER_SHARE, SPEAKER_SPACING_M = (0.15, 0.4), (0.03, 0.08)
MICROPHONE_SHARE, MICROPHONE_SPACING_M = (0.05, 0.25), (0.01, 0.06)
ACROSS = 0.4
"""How far the axis of lobes leaves the phone's right, a standard deviation of each component."""
NOISE = (2.8e-4, 5e-4)
"""Of a phone whose response and ringing have an rms of 1."""
CONTROLLED_SHARE = 0.5
"""Of phones that ride the gain whatever they are told."""


def ordinary_traits(
    generator: np.random.Generator, response: F64, frequency_hz: F64
) -> dict[str, Any]:
    """Fields of a Device, drawn at random for a response (n) at frequencies (n)."""
    modes = _resonances(generator)
    heard = (frequency_hz >= HEARD_HZ[0]) & (frequency_hz <= HEARD_HZ[1])
    gain = np.abs(response * ringing(modes, frequency_hz))[heard]
    speaker = _lobes(generator, SPEAKER_SHARE, SPEAKER_SPACING_M)
    microphone = _lobes(generator, MICROPHONE_SHARE, MICROPHONE_SPACING_M)
    noise = generator.uniform(*NOISE) * np.sqrt(np.mean(gain**2))
    control = GainControl(
        attack_s=generator.uniform(0.002, 0.010),
        release_s=generator.uniform(0.1, 0.5),
        target_level=generator.uniform(0.02, 0.1),
        most_gain_db=generator.uniform(12.0, 30.0),
    )
    controlled = generator.uniform() < CONTROLLED_SHARE
    return _traits(modes, speaker, microphone, float(noise), control if controlled else None)


def traits_of_one() -> dict[str, Any]:
    """Of the built-in ordinary phone."""
    modes = (
        Resonance(15_700.0, 8.0, 0.5),
        Resonance(17_200.0, 14.0, -0.4),
        Resonance(18_900.0, 20.0, 0.6),
    )
    speaker = Lobes(0.3, 0.07, np.array([0.96, 0.0, 0.28]))
    return _traits(modes, speaker, Lobes(0.15, 0.03, np.array([0.8, 0.0, -0.6])), 3.6e-4, None)


def traits_of_another() -> dict[str, Any]:
    """Of the other built-in ordinary phone, which rides its gain."""
    modes = (Resonance(16_300.0, 20.0, 0.7), Resonance(19_300.0, 9.0, 0.5))
    speaker = Lobes(0.22, 0.045, np.array([0.8, 0.6, 0.0]))
    return _traits(modes, speaker, Lobes(0.2, 0.055), 7e-4, GainControl(0.005, 0.25, 0.05, 18.0))


def _traits(
    modes: tuple[Resonance, ...],
    speaker: Lobes,
    microphone: Lobes,
    noise_rms: float,
    control: GainControl | None,
) -> dict[str, Any]:
    return {
        "ringing": modes,
        "speaker_lobes": speaker,
        "microphone_lobes": microphone,
        "noise_rms": noise_rms,
        "gain_control": control,
    }


def _resonances(generator: np.random.Generator) -> tuple[Resonance, ...]:
    count = int(generator.integers(RESONANCES[0], RESONANCES[1] + 1))
    frequency_hz = generator.uniform(*HEARD_HZ, count)
    q = np.pi * frequency_hz * generator.uniform(*DECAY_S, count)
    gain = generator.uniform(*RESONANCE_GAIN, count) * generator.choice([-1.0, 1.0], count)
    return tuple(map(Resonance, frequency_hz.tolist(), q.tolist(), gain.tolist()))


def _lobes(
    generator: np.random.Generator, share: tuple[float, float], spacing_m: tuple[float, float]
) -> Lobes:
    """Mostly across the phone."""
    axis = np.array([1.0, 0.0, 0.0]) + ACROSS * generator.standard_normal(3)
    unit = axis / np.linalg.norm(axis)
    return Lobes(generator.uniform(*share), generator.uniform(*spacing_m), unit)
