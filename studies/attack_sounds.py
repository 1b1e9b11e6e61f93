"""What attackers send: each attack is a sound laid over a walk from its onset on.

Levels are in dB against the phone's own loudspeaker, and of a replay against what was recorded.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64, I64
from elfslam.world.recorder import louder
from studies.attacked_walk import (
    PERIOD,
    PLACED_M,
    RATE_HZ,
    Walked,
    from_the_phone,
    laid,
    through_room,
    to_the_phone,
)

ONSET_SHARE = 0.3
"""An attack begins after this share of the walk."""
OWN_RHYTHM_S = 0.0937
CLOCK_PPM = 40.0
"""By how much an attacker's clock is off the phone's."""
SLOW_REACTION_S = 0.015
ECHOES_FROM, ECHOES_TO = 485, 4_000
"""Samples behind a direct arrival that are its echoes."""
FELT_S = 0.003
"""So much of a chirp is listened to by who follows its loudness."""
FELT_CHIRPS = 20
"""The loudest of so many before is what its loudness is held against."""
SWEEP_S = 0.05
RAMP_S = 40.0
RAMP_FROM_DB = -30.0
BAND_HZ = (15_000.0, 20_000.0)


@dataclass(frozen=True, eq=False)
class Victim:
    """A walk under attack: by a loudspeaker at `speaker_m`, with another walk's sound to replay."""

    walked: Walked
    other: Walked
    speaker_m: F64
    seed: int

    @property
    def onset(self) -> int:
        """The sample at which the attack begins."""
        return int(ONSET_SHARE * len(self.walked.own))

    @property
    def away_m(self) -> F64:
        """How far the loudspeaker is from the phone at each chirp (k)."""
        return np.asarray(
            np.linalg.norm(self.walked.poses.position_m - self.speaker_m, axis=1), np.float64
        )

    @property
    def sound_s(self) -> F64:
        """How long sound is on its way between the two at each chirp (k)."""
        return np.asarray(self.away_m / self.walked.air.speed_mps)


Sound = Callable[[Victim, float], F32]
"""A victim and a level in dB in, what comes to its microphone (n) out."""


def gain(level_db: float) -> float:
    """The factor of an amplitude."""
    return float(10 ** (level_db / 20))


def chirping_neighbours(walked: Walked, speakers_m: Sequence[F64], seed: int) -> F32:
    """What the microphone gets (n) of other phones that stand (2) and chirp, each at random."""
    total = np.zeros(len(walked.own), dtype=np.float32)
    for k, place_m in enumerate(speakers_m):
        generator = np.random.default_rng([seed, 23, k])
        phase = int(generator.integers(PERIOD))
        periods = np.arange(phase, len(total), PERIOD)
        starts = periods + generator.integers(0, round(0.025 * RATE_HZ), len(periods))
        victim = Victim(walked, walked, np.append(place_m, PLACED_M), seed)
        sent = _chirps(victim, starts.astype(np.int64), 0.0, from_start=True)
        total += _from_loudspeaker(victim, sent)
    return total


def own_rhythm(victim: Victim, level_db: float) -> F32:
    """Chirps as the phone's, at a rhythm of the attacker's own."""
    every = OWN_RHYTHM_S * RATE_HZ
    starts = np.arange(victim.onset, len(victim.walked.own), every).astype(np.int64)
    return _from_loudspeaker(victim, _chirps(victim, starts, level_db))


def same_rhythm(victim: Victim, level_db: float) -> F32:
    """Chirps of the phone's own period, off its clock by a little."""
    every = PERIOD * (1 + CLOCK_PPM * 1e-6)
    phase = np.random.default_rng([victim.seed, 20]).integers(PERIOD)
    starts = np.arange(victim.onset + phase, len(victim.walked.own), every).astype(np.int64)
    return _from_loudspeaker(victim, _chirps(victim, starts, level_db))


def replayed_chirps(victim: Victim, level_db: float, *, after_s: float) -> F32:
    """Each chirp of the phone once more, `after_s` behind its coming to the attacker."""
    late = np.round((victim.sound_s + after_s) * RATE_HZ).astype(np.int64)
    return _from_loudspeaker(victim, _own_chirps(victim, late, level_db))


def replayed_room(victim: Victim, level_db: float, *, after_s: float) -> F32:
    """All that the attacker hears of the phone's chirps in the room, `after_s` later."""
    walked = victim.walked
    sent = _own_chirps(victim, np.zeros_like(walked.played), 0.0, from_start=True)
    heard = through_room(walked, sent, from_the_phone(walked, victim.speaker_m))
    late = np.roll(heard, round(after_s * RATE_HZ)) * gain(level_db) * victim.away_m.mean()
    return _from_loudspeaker(victim, _begun(victim, np.asarray(late, np.float32)))


def echoes_of_elsewhere(
    victim: Victim, level_db: float, *, missing_s: float = 0.0, route: str = "far"
) -> F32:
    """Echoes recorded on another walk behind each of the phone's chirps, straight to the ear.

    Timed as well as can be by hearing the chirp; the first `missing_s` of them come too late.
    `route` is as in `_theirs`.
    """
    starts = victim.walked.played
    return _elsewhere(victim, starts, level_db, missing_s=missing_s, route=route)


def following_echoes(victim: Victim, level_db: float) -> F32:
    """As `echoes_of_elsewhere`, each as loud as the beginning of its chirp says.

    The attacker hears the chirp at the phone's ear, and has 8 ms from there to the first echo.
    """
    walked = victim.walked
    rows = walked.played[:, None] + np.arange(round(FELT_S * RATE_HZ))
    felt = np.sqrt(np.mean(walked.own[np.minimum(rows, len(walked.own) - 1)] ** 2, axis=1))
    loudest = [felt[max(k - FELT_CHIRPS, 0) : k + 1].max() for k in range(len(felt))]
    return _elsewhere(victim, walked.played, level_db, follows=felt / np.array(loudest))


def predicted_echoes(victim: Victim, level_db: float) -> F32:
    """Echoes recorded on another walk, where the middle of a schedule puts the next chirp."""
    walked = victim.walked
    period = np.arange(len(walked.played)) * PERIOD
    starts = period + round(float(np.mean(walked.played - period)))
    return _elsewhere(victim, starts, level_db)


def recorded_walk(victim: Victim, level_db: float) -> F32:
    """Another walk as its own phone heard it, direct sound included, straight to the ear."""
    size = len(victim.walked.own)
    theirs = np.resize(victim.other.own, size + PERIOD)[PERIOD // 3 :][:size]
    return _begun(victim, np.asarray(gain(level_db) * theirs, np.float32))


def ramped_echoes(victim: Victim, level_db: float) -> F32:
    """Echoes that lead away and grow slowly, from far beneath the room's own, to a level."""
    loud = echoes_of_elsewhere(victim, 0.0, route="near")
    t_s = (np.arange(len(loud)) - victim.onset) / RATE_HZ
    share = np.clip(t_s / RAMP_S, 0.0, 1.0)
    levels = 10 ** ((RAMP_FROM_DB + share * (level_db - RAMP_FROM_DB)) / 20)
    return np.asarray(loud * levels, np.float32)


def noise(victim: Victim, level_db: float) -> F32:
    """Noise over the chirp's band."""
    white = np.random.default_rng([victim.seed, 21]).standard_normal(len(victim.walked.own))
    shaped = signal.sosfilt(signal.butter(4, BAND_HZ, "bandpass", fs=RATE_HZ, output="sos"), white)
    return _jam(victim, shaped / shaped.std(), level_db)


def tone(victim: Victim, level_db: float) -> F32:
    """A tone in the middle of the band."""
    t_s = np.arange(len(victim.walked.own)) / RATE_HZ
    return _jam(victim, np.sqrt(2) * np.sin(2 * np.pi * 17_500 * t_s), level_db)


def sweeps(victim: Victim, level_db: float) -> F32:
    """Slow sweeps through the band without a pause."""
    t_s = np.arange(len(victim.walked.own)) / RATE_HZ % SWEEP_S
    low_hz, high_hz = BAND_HZ
    turns = low_hz * t_s + (high_hz - low_hz) * t_s**2 / (2 * SWEEP_S)
    return _jam(victim, np.sqrt(2) * np.sin(2 * np.pi * turns), level_db)


SOUNDS: Mapping[str, Sound] = MappingProxyType(
    {
        "chirps, own rhythm": own_rhythm,
        "chirps, our period": same_rhythm,
        "replayed chirp, 2 ms": partial(replayed_chirps, after_s=0.002),
        "replayed chirp, 15 ms": partial(replayed_chirps, after_s=0.015),
        "replayed chirp, 40 ms": partial(replayed_chirps, after_s=0.040),
        "replayed room, 2 ms": partial(replayed_room, after_s=0.002),
        "replayed room, 15 ms": partial(replayed_room, after_s=0.015),
        "echoes of elsewhere, predicted": predicted_echoes,
        "echoes of elsewhere, reactive": echoes_of_elsewhere,
        "echoes of elsewhere, 15 ms late": partial(echoes_of_elsewhere, missing_s=SLOW_REACTION_S),
        "echoes of elsewhere, following": following_echoes,
        "echoes of one place, reactive": partial(echoes_of_elsewhere, route="still"),
        "echoes that lead away, reactive": partial(echoes_of_elsewhere, route="near"),
        "noise": noise,
        "tone": tone,
        "sweeps": sweeps,
        "recorded walk": recorded_walk,
        "recorded walk, own chirp muffled": recorded_walk,
        "ramped echoes that lead away": ramped_echoes,
    }
)
OWN_GAIN: Mapping[str, float] = MappingProxyType({"recorded walk, own chirp muffled": 0.01})
"""How much is heard of the phone's own sound where the attacker keeps it from the microphone."""


def _chirps(
    victim: Victim,
    starts: I64,
    level_db: float,
    *,
    from_start: bool = False,
    gain_db: F64 | None = None,
) -> F32:
    """A stream of chirps that start then, each by so much louder.

    Those before the onset are left out.
    """
    walked = victim.walked
    kept = np.full(len(starts), True) if from_start else starts >= victim.onset
    sound = walked.device.level * gain(level_db) * walked.chirp.samples
    sounds = np.tile(sound, (int(kept.sum()), 1))
    if gain_db is not None:
        sounds = louder(sounds, gain_db[kept])
    return laid(sounds, starts[kept], len(walked.own))


def _own_chirps(victim: Victim, late: I64, level_db: float, *, from_start: bool = False) -> F32:
    """A stream of the phone's chirps, so many samples later and each as loud as it was."""
    walked = victim.walked
    return _chirps(
        victim, walked.played + late, level_db, from_start=from_start, gain_db=walked.gain_db
    )


def _from_loudspeaker(victim: Victim, sent: F32) -> F32:
    return through_room(victim.walked, sent, to_the_phone(victim.walked, victim.speaker_m))


def _jam(victim: Victim, shape: F64, level_db: float) -> F32:
    loud = victim.walked.device.level * gain(level_db) * shape
    return _from_loudspeaker(victim, _begun(victim, np.asarray(loud, np.float32)))


def _begun(victim: Victim, sound: F32) -> F32:
    """The sound from the onset on."""
    return np.where(np.arange(len(sound)) >= victim.onset, sound, np.float32(0))


def _elsewhere(
    victim: Victim,
    starts: I64,
    level_db: float,
    *,
    missing_s: float = 0.0,
    route: str = "far",
    follows: F64 | None = None,
) -> F32:
    """Echoes of the other walk as if a chirp of ours had started then.

    `follows` are factors of their amplitude, chirp by chirp.
    """
    other, walked = victim.other, victim.walked
    first = max(ECHOES_FROM, round(missing_s * RATE_HZ))
    fresh = np.flatnonzero(starts >= victim.onset)
    rows = other.played[_theirs(victim, fresh, route)][:, None] + np.arange(first, ECHOES_TO)
    sounds = gain(level_db) * other.own[np.minimum(rows, len(other.own) - 1)]
    if follows is not None:
        sounds = sounds * follows[fresh][:, None]
    return laid(np.asarray(sounds, np.float32), starts[fresh] + first, len(walked.own))


def _theirs(victim: Victim, fresh: I64, route: str) -> I64:
    """Which chirps of the other walk are replayed: from where it is `far` or `near`, or `still`.

    Far and near are from where the phone is at the onset; `still` stays at the far place.
    """
    here_m = victim.walked.poses.position_m[fresh[0]]
    away_m = np.linalg.norm(victim.other.poses.position_m - here_m, axis=1)
    first = int(np.argmin(away_m) if route == "near" else np.argmax(away_m))
    if route == "still":
        return np.full(len(fresh), first)
    return np.asarray((first + fresh - fresh[0]) % len(victim.other.played))
