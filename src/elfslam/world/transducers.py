"""What phones and the hands that hold them do to sound beside a response; ordinary phones' traits.

No measurement of ringing, lobes and gain control was found. Their ranges are estimates that agree
with what is known of transducers of a centimetre: decays of tenths of a millisecond, lobes of some
dB. How loud a phone hears itself, and its noise, were measured (`device.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np

from elfslam.base.arrays import C128, F32, F64, Value, array
from elfslam.base.errors import InputError

LEVEL_S = 0.002
"""Time constant of the power that is looked at."""
SILENCE = 1e-20
"""Power below which nothing more is told apart."""


@dataclass(frozen=True)
class GainControl:
    """A gain that brings the recording to `target_level` (rms), by `most_gain_db` at most.

    In decibels the gain nears what is wanted with the time constant `attack_s` where it falls and
    `release_s` where it rises (the branching smoother of Giannoulis, Massberg and Reiss, J. Audio
    Eng. Soc. 60, 2012). It begins at 0 dB. Raises InputError for times or a target not above 0.
    """

    attack_s: float = 0.005
    release_s: float = 0.3
    target_level: float = 0.05
    most_gain_db: float = 24.0

    def __post_init__(self) -> None:
        above_zero = min(self.attack_s, self.release_s, self.target_level) > 0
        if not (above_zero and 0 <= self.most_gain_db < np.inf):
            raise InputError(
                f"gain control: wanted times and a target above 0 and a gain from 0 dB, got "
                f"{self.attack_s} s, {self.release_s} s, {self.target_level} and "
                f"{self.most_gain_db} dB; correct them"
            )


def controlled(
    samples: F32, control: GainControl | None, rate_hz: int, clip_level: float = 1.0
) -> F32:
    """The recording (n) after its gain control, limited to `clip_level`; as it is without one."""
    if control is None:
        return samples
    steps = [
        1 - np.exp(-1 / (time_s * rate_hz))
        for time_s in (LEVEL_S, control.attack_s, control.release_s)
    ]
    target_db = 20 * np.log10(control.target_level)
    loud = _ride(samples.astype(np.float32), target_db, control.most_gain_db, *steps)
    return np.asarray(np.clip(loud, -clip_level, clip_level), dtype=np.float32)


@numba.njit(cache=True, fastmath=True, nogil=True)
def _ride(samples, target_db, most_gain_db, level, attack, release):  # type: ignore[no-untyped-def]
    """The samples, each times the gain of its moment."""
    out = np.empty_like(samples)
    power, gain_db = 0.0, 0.0
    for n in range(len(samples)):
        x = float(samples[n])
        power += level * (x * x - power)
        wanted_db = min(target_db - 10.0 * np.log10(power + SILENCE), most_gain_db)
        gain_db += (attack if wanted_db < gain_db else release) * (wanted_db - gain_db)
        out[n] = x * 10.0 ** (0.05 * gain_db)
    return out


@dataclass(frozen=True, eq=False)
class Lobes(Value):
    """Lobes of a transducer, which the edges of the phone make: a pair of sources beside it.

    They stand `spacing_m` apart along `axis` (of the phone's axes, the transducer in the middle)
    and have `share` of the sound between them; all are in phase. Far away this is a gain of
    (1 - share) + share cos(pi spacing cos(angle to the axis) / wavelength). Raises InputError for
    a share beyond 0 to 1 or a negative spacing.
    """

    share: float = 0.0
    spacing_m: float = 0.0
    axis: F64 = field(
        default_factory=lambda: np.array([1.0, 0.0, 0.0]),
        metadata=array(3, unit_rows=True).metadata,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (0 <= self.share <= 1 and 0 <= self.spacing_m < np.inf):
            raise InputError(
                f"lobes: wanted a share from 0 to 1 and a spacing from 0, got {self.share} and "
                f"{self.spacing_m} m; correct them"
            )


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


NEAR_PATHS = 24
"""So many make a burst whose envelope is nearly Rayleigh's."""


@dataclass(frozen=True)
class NearField:
    """What the holder's hand, arm and body scatter of far sound, as it leaves and as it arrives.

    All of it has `gain` times the amplitude (rms) of the plain sound, and its power decays by
    exp(-t / `decay_s`). Its paths are drawn by `seed`. The direct sound, which is much nearer,
    has none of it. Raises InputError for a negative gain or a decay not above 0.
    """

    gain: float
    decay_s: float
    seed: int = 0

    def __post_init__(self) -> None:
        if not (0 <= self.gain < np.inf and 0 < self.decay_s < np.inf):
            raise InputError(
                f"near field: wanted a gain from 0 and a decay above 0, got {self.gain} and "
                f"{self.decay_s} s; correct them"
            )


HAND = NearField(0.7, 0.6e-3, seed=1)
"""Cross-sections of a hand (0.01 m2) at 8 cm, a forearm (0.02 m2) at 25 cm and a clothed body at
35 cm, out and back, add up to half the power of the plain sound within a millisecond."""


def near_field(around: NearField, frequency_hz: F64) -> C128:
    """Complex gain (n) of far sound at frequencies (n): 1, and each of the near paths."""
    generator = np.random.default_rng(around.seed)
    share = (np.arange(NEAR_PATHS) + generator.uniform(size=NEAR_PATHS)) / NEAR_PATHS
    delay_s, sign = -around.decay_s * np.log1p(-share), generator.choice([-1.0, 1.0], NEAR_PATHS)
    turned = np.exp(-2j * np.pi * np.multiply.outer(frequency_hz, delay_s))
    return np.asarray(1 + around.gain / np.sqrt(NEAR_PATHS) * (turned @ sign))


RESONANCES = (2, 4)
HEARD_HZ = (15_000.0, 20_000.0)
DECAY_S = (0.1e-3, 0.4e-3)
"""Of a resonance to 1 / e; it is 20 dB down after 0.23 to 0.92 ms."""
RESONANCE_GAIN = (0.2, 0.8)
SPEAKER_SHARE, SPEAKER_SPACING_M = (0.15, 0.4), (0.03, 0.08)
MICROPHONE_SHARE, MICROPHONE_SPACING_M = (0.05, 0.25), (0.01, 0.06)
ACROSS = 0.4
"""How far the axis of lobes leaves the phone's right, a standard deviation of each component."""
NEAR_GAIN, NEAR_DECAY_S = (0.5, 0.9), (0.4e-3, 0.8e-3)
CONTROLLED_SHARE = 0.5
"""Of phones that ride the gain whatever they are told."""


def ordinary_traits(generator: np.random.Generator) -> dict[str, Any]:
    """Fields of a Device, drawn at random."""
    modes = _resonances(generator)
    speaker = _lobes(generator, SPEAKER_SHARE, SPEAKER_SPACING_M)
    microphone = _lobes(generator, MICROPHONE_SHARE, MICROPHONE_SPACING_M)
    control = GainControl(
        attack_s=generator.uniform(0.002, 0.010),
        release_s=generator.uniform(0.1, 0.5),
        target_level=generator.uniform(0.02, 0.1),
        most_gain_db=generator.uniform(12.0, 30.0),
    )
    controlled = generator.uniform() < CONTROLLED_SHARE
    around = NearField(
        generator.uniform(*NEAR_GAIN),
        generator.uniform(*NEAR_DECAY_S),
        int(generator.integers(2**32)),
    )
    traits = _traits(modes, speaker, microphone, control if controlled else None)
    return {**traits, "near_field": around}


def traits_of_one() -> dict[str, Any]:
    """Of the built-in ordinary phone."""
    modes = (
        Resonance(15_700.0, 8.0, 0.5),
        Resonance(17_200.0, 14.0, -0.4),
        Resonance(18_900.0, 20.0, 0.6),
    )
    speaker = Lobes(0.3, 0.07, np.array([0.96, 0.0, 0.28]))
    return _traits(modes, speaker, Lobes(0.15, 0.03, np.array([0.8, 0.0, -0.6])), None)


def traits_of_another() -> dict[str, Any]:
    """Of the other built-in ordinary phone, which rides its gain."""
    modes = (Resonance(16_300.0, 20.0, 0.7), Resonance(19_300.0, 9.0, 0.5))
    speaker = Lobes(0.22, 0.045, np.array([0.8, 0.6, 0.0]))
    return _traits(modes, speaker, Lobes(0.2, 0.055), GainControl(0.005, 0.25, 0.05, 18.0))


def _traits(
    modes: tuple[Resonance, ...],
    speaker: Lobes,
    microphone: Lobes,
    control: GainControl | None,
) -> dict[str, Any]:
    return {
        "ringing": modes,
        "speaker_lobes": speaker,
        "microphone_lobes": microphone,
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
