"""Where a recording has sound and motion, and what of either is missing between its ends."""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Echoes, Recording
from elfslam.stages.motion import MotionParameters

SOUND, MOTION = "sound", "motion"
BLOCK_S = 0.1
"""Sound is looked for in pieces of one period."""
UNHEARD_S = 1.0
"""Chirps may be unheard for so long before it is said: somebody's hand, somebody else's turn."""
TURNS = 5
"""So many usual waits from chirp to chirp are no gap either, where many phones share the air."""


@dataclass(frozen=True)
class Missing:
    """A stretch in which a recording lacks its sound or its motion."""

    what: str
    from_s: float
    until_s: float

    def __str__(self) -> str:
        return f"{self.what} is missing from {self.from_s:.1f} to {self.until_s:.1f} s"


def spans_of(recording: Recording, parameters: MotionParameters) -> dict[str, F64]:
    """From when until when (k, 2) there is sound, and motion; none where a recording has no such.

    Interruptions of at most `longest_gap_s` are not told.
    """
    spans = {}
    if recording.audio is not None:
        spans[SOUND] = _sounding(recording.audio, parameters.longest_gap_s)
    if (t_s := motion_times_s(recording)) is not None:
        spans[MOTION] = stretches(t_s, parameters.longest_gap_s)
    return spans


def motion_times_s(recording: Recording) -> F64 | None:
    """When motion was measured: by the motion sensors, or else by the device's own odometry.

    Of a cropped recording that is when it was in the whole. Raises InputError where these gave
    nothing.
    """
    if recording.motion_t_s is not None:
        return recording.motion_t_s
    motion = recording.imu or recording.odometry
    if motion is not None and len(motion.t_s) == 0:
        raise InputError(f"{recording.name}: wanted rows of motion, got none; record again")
    return None if motion is None else motion.t_s


def duration_s(recording: Recording) -> float | None:
    """How long the motion sensors ran, against which lost samples of the sound are measured.

    Sound whose stretches have times of their own lacks none: it ran for as long as it says.
    """
    audio, t_s = recording.audio, motion_times_s(recording)
    if audio is not None and audio.is_timed:
        return float(audio.samples.shape[1] / audio.rate_hz)
    return None if t_s is None else float(t_s[-1])


def stretches(t_s: F64, gap_s: float) -> F64:
    """From when until when (k, 2) rising times follow each other by at most `gap_s`."""
    if not len(t_s):
        return np.empty((0, 2))
    begins = np.flatnonzero(np.diff(t_s) > gap_s) + 1
    return np.column_stack([t_s[np.r_[0, begins]], t_s[np.r_[begins - 1, len(t_s) - 1]]])


def within(t_s: F64, spans: F64) -> Bool:
    """Which times (n) lie in one of the spans, ends included."""
    inside = (t_s[:, None] >= spans[:, 0]) & (t_s[:, None] <= spans[:, 1])
    return np.asarray(inside.any(axis=1))


def missing_of(
    recording: Recording, echoes: Echoes | None, parameters: MotionParameters
) -> tuple[Missing, ...]:
    """What a map of a recording lacks between the recording's ends, in the order of time.

    Sound is missing where no echo was heard; a walk that is mapped without `echoes` lacks none.
    """
    spans = spans_of(recording, parameters)
    motion = spans[MOTION]
    ends_s = np.concatenate([each.ravel() for each in spans.values() if echoes or each is motion])
    from_s, until_s = float(ends_s.min()), float(ends_s.max())
    if recording.crop_s is not None:
        from_s, until_s = max(from_s, recording.crop_s[0]), min(until_s, recording.crop_s[1])
    found = _gaps(MOTION, motion, from_s, until_s, parameters.longest_gap_s)
    if echoes is not None and len(echoes.t_s) > 1:
        heard, wait_s = _heard(echoes.t_s)
        sounds_s = _first_chirp_s(recording, from_s)
        begins_late = heard[0, 0] - sounds_s > UNHEARD_S
        first_s = sounds_s if begins_late else float(heard[0, 0])
        found += _gaps(SOUND, heard, first_s, until_s - wait_s, parameters.longest_gap_s)
    return tuple(sorted(found, key=lambda each: (each.from_s, each.what)))


def _first_chirp_s(recording: Recording, from_s: float) -> float:
    """From when on chirps could be heard: a phone first listens whether others chirp."""
    played_t_s = recording.played_t_s
    later = played_t_s[played_t_s >= from_s] if played_t_s is not None else np.empty(0)
    return float(later[0]) if len(later) else from_s


def _heard(t_s: F64) -> tuple[F64, float]:
    """From when until when echoes were heard, and how long one usually waits for the next."""
    wait_s = float(np.median(np.diff(t_s)))
    return stretches(t_s, max(UNHEARD_S, TURNS * wait_s)), wait_s


def _gaps(what: str, spans: F64, from_s: float, until_s: float, least_s: float) -> list[Missing]:
    """The stretches between two times that no span covers and that are longer than `least_s`."""
    inside = np.clip(spans, from_s, max(from_s, until_s))
    ends = np.concatenate([[from_s], inside.ravel(), [max(from_s, until_s)]]).reshape(-1, 2)
    return [
        Missing(what, round(float(begin), 2), round(float(end), 2))
        for begin, end in ends
        if end - begin > least_s
    ]


def _sounding(audio: Audio, gap_s: float) -> F64:
    """From when until when any channel has more than digital silence, to a block."""
    block = round(BLOCK_S * audio.rate_hz)
    samples = np.asarray(audio.samples.any(axis=0))
    padded = np.pad(samples, (0, -len(samples) % block)).reshape(-1, block)
    loud = np.flatnonzero(padded.any(axis=1))
    found = stretches(np.asarray(loud * BLOCK_S, dtype=np.float64), gap_s + BLOCK_S)
    found[:, 1] = np.minimum(found[:, 1] + BLOCK_S, len(samples) / audio.rate_hz)
    return found
