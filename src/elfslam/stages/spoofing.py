"""Replay and spoofing detection: can this be the room's answer to the phone's own chirps?

Each frame is looked at for what no room does: sound before the direct arrival, echoes louder than
any room returns them, noise in the chirp's band, the own chirp missing or off its time. A stretch
of time is SUSPECT where too many of the frames up to its end are odd in one and the same way.

Where each chirp had a loudness of its own, the room's echoes follow it, dB for dB, and sound that
somebody else plays does not: a stretch is SUSPECT, too, where echoes lag behind their chirps. Both
are measured against each other in what was heard: whatever gain the microphone has is in both.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.parameters import parameter
from elfslam.base.values import ECHO_SAMPLES, Echoes, FrameFacts

Suspicion = Callable[[F64], Bool]
"""Times (n) in, whether each stretch between them (n-1) is suspect out."""
PARTS = 4
"""Into so many parts of equal length an echo trace falls (13.3 ms each)."""
SHARPENED = (2 * np.sin(np.pi * 17_500 / 44_100)) ** 4
"""What the fourth difference makes of the middle of the band."""
RECENT = 7
"""Chirps whose median says when a direct arrival is due."""
REASONS = (
    "",
    "the own chirp comes at another time than it was played",
    "sound comes before its chirp",
    "echoes are louder than a room returns them",
    "there is noise in the band of the chirp",
    "the microphone is driven to its limit",
    "echoes do not follow the loudness of their chirps",
)
"""By number; 0 is trusted."""
LAGGING = len(REASONS) - 1
HISS = 7.7
"""White noise in an echo trace (rms of fourth differences) over that in the envelope (median)."""
CALM = 0.5
"""Both limits of a lag are so much lower while SUSPECT."""


@dataclass(frozen=True)
class SpoofingParameters:
    """From when on a frame is odd, and how many odd frames are too many."""

    memory_s: float = parameter(1.8, "s", "how far back the frames that are judged lie", 0.2, 60.0)
    odd_share: float = parameter(
        0.34, "", "this share of odd frames makes a stretch SUSPECT", 0.01, 1.0
    )
    calm_share: float = parameter(
        0.12, "", "it stays SUSPECT until fewer frames than this share are odd", 0.0, 1.0
    )
    fewest_frames: int = parameter(6, "", "fewer frames are not judged", 1, 600)
    off_time_s: float = parameter(
        0.001, "s", "a direct arrival this far off its time is odd", 0.0, 1.0
    )
    before: float = parameter(
        0.03, "", "envelope before a direct arrival over its own that is odd", 0.0, 1e6
    )
    noise: float = parameter(
        0.003, "", "noise before a direct arrival over its level that is odd", 0.0, 1e6
    )
    loud_first: float = parameter(
        0.16, "", "first part of an echo trace (rms) over the direct level, odd", 0.0, 1e6
    )
    loud_second: float = parameter(0.065, "", "second part of an echo trace, likewise", 0.0, 1e6)
    loud_third: float = parameter(0.033, "", "third part of an echo trace, likewise", 0.0, 1e6)
    loud_last: float = parameter(0.017, "", "last part of an echo trace, likewise", 0.0, 1e6)
    clipped: float = parameter(0.01, "", "share of samples at full scale that is odd", 0.0, 1.0)
    compared_chirps: int = parameter(
        24, "", "chirps of which it is told whether echoes follow their loudness", 8, 600
    )
    lag: float = parameter(
        0.3, "", "dB per dB of their chirps that echoes lack: SUSPECT from there on", 0.0, 1.0
    )
    clear_db: float = parameter(
        10.0, "dB", "parts of an echo trace count where they are so far over noise", 0, 60
    )
    lag_errors: float = parameter(
        5.0, "", "standard errors that such a lag has, at the least", 0.0, 100.0
    )


def judge(
    facts: FrameFacts,
    echoes: Echoes,
    edges_s: F64,
    parameters: SpoofingParameters,
    clean: Echoes | None = None,
) -> I64:
    """Number of the reason (n-1) to suspect each stretch between times (n); 0 where there is none.

    `REASONS` has them in words. A stretch is judged by the frames up to its end, and more strictly
    behind one that is suspect. Loudness is compared among `clean` echoes alone, where it is known
    that others chirped into some.
    """
    odd = odd_frames(facts, echoes, parameters)
    chirps = heard_chirps(facts, echoes if clean is None else clean)
    reasons = [0]
    for end_s in edges_s[1:]:
        was_suspect = reasons[-1] > 0
        reason = _reason(odd, facts.t_due_s, end_s, parameters, was_suspect=was_suspect)
        lags = echoes_lag(chirps, end_s, parameters, was_suspect=was_suspect)
        reasons.append(reason or (LAGGING if lags else 0))
    return np.array(reasons[1:], dtype=np.int64)


def suspicion(
    facts: FrameFacts, echoes: Echoes, parameters: SpoofingParameters, clean: Echoes | None = None
) -> Suspicion:
    """Whether stretches between times (n) are suspect (n-1), by what was heard."""
    return lambda edges_s: judge(facts, echoes, edges_s, parameters, clean) > 0


def nothing_suspect(edges_s: F64) -> Bool:
    """No stretch (n-1) is."""
    return np.zeros(len(edges_s) - 1, dtype=np.bool_)


def odd_frames(facts: FrameFacts, echoes: Echoes, parameters: SpoofingParameters) -> Bool:
    """Which frames (m) are odd in which way (a column per reason but the first)."""
    known = parameters
    level = np.maximum(facts.level, 1e-12)
    bounds = np.array([known.loud_first, known.loud_second, known.loud_third, known.loud_last])
    return np.column_stack(
        [
            off_time_s(facts) > known.off_time_s,
            facts.before > known.before,
            (loudness(facts, echoes) > bounds).any(axis=1),
            facts.noise / level > known.noise,
            facts.clipped > known.clipped,
        ]
    )


def off_time_s(facts: FrameFacts) -> F64:
    """How far each direct arrival (m) is off the time at which the recent ones came.

    Infinite where none came; 0 for the first.
    """
    off_s = np.full(len(facts.late_s), np.inf)
    recent: list[float] = []
    for k, late_s in enumerate(facts.late_s.tolist()):
        if np.isnan(late_s):
            continue
        off_s[k] = abs(late_s - float(np.median(recent))) if recent else 0.0
        recent = [*recent, late_s][-RECENT:]
    return off_s


def loudness(facts: FrameFacts, echoes: Echoes) -> F64:
    """Root mean square of each part of the echo trace over the direct level (m, 4).

    Of its fourth differences, which leave little of what is below the chirp's band; 0 for frames
    without an echo.
    """
    arrived_s = facts.t_due_s + np.nan_to_num(facts.late_s)
    loud = np.zeros((len(arrived_s), PARTS))
    if len(arrived_s) == 0:
        return loud
    frame = _nearest(arrived_s, echoes.t_s)
    sharp = np.zeros(echoes.samples.shape)
    sharp[:, 4:] = np.diff(echoes.samples.astype(np.float64), n=4)
    parts = sharp.reshape(-1, PARTS, ECHO_SAMPLES // PARTS)
    loud[frame] = np.sqrt(np.mean(parts**2, axis=2)) / SHARPENED
    return np.asarray(loud / np.maximum(facts.level, 1e-12)[:, None])


def heard_chirps(facts: FrameFacts, echoes: Echoes) -> F64:
    """Of each chirp whose echoes were heard (k, 7): when it was due (s), how loud it was played,
    and the noise and each part of its echo trace over its direct sound (dB).

    None where nobody says how loud chirps were played.
    """
    if facts.gain_db is None:
        return np.empty((0, 3 + PARTS))
    loud = loudness(facts, echoes)
    heard = (loud > 0).all(axis=1) & ~np.isnan(facts.late_s)
    hiss = HISS * facts.noise[heard] / np.maximum(facts.level[heard], 1e-12)
    over_direct_db = 20 * np.log10(np.column_stack([np.maximum(hiss, 1e-12), loud[heard]]))
    return np.column_stack([facts.t_due_s[heard], facts.gain_db[heard], over_direct_db])


def echoes_lag(
    chirps: F64, end_s: float, parameters: SpoofingParameters, *, was_suspect: bool
) -> bool:
    """Whether echoes did not follow the loudness of the last chirps before then.

    The room's echoes over the direct sound are alike however loud the chirp; what is added to them
    is over a soft one's the louder. Noise is, too: parts of the trace near it do not count. The
    others do by their mean in dB, as late echoes are as steady as early ones.
    """
    last = int(np.searchsorted(chirps[:, 0], end_s))
    if last <= parameters.compared_chirps:
        return False
    compared = chirps[last - parameters.compared_chirps - 1 : last]
    gain_db, hiss_db, parts_db = compared[:, 1], compared[:, 2], compared[:, 3:]
    clear = np.median(parts_db - hiss_db[:, None], axis=0) >= parameters.clear_db
    played_db = np.diff(gain_db)
    spread = float(np.sum(played_db**2))
    if spread == 0 or not clear.any():
        return False
    echoes_db = np.diff(parts_db[:, clear].mean(axis=1))
    lag = -float(np.sum(played_db * echoes_db)) / spread
    rest = float(np.sum((echoes_db + lag * played_db) ** 2)) / (len(played_db) - 1)
    limit = max(parameters.lag, parameters.lag_errors * np.sqrt(rest / spread))
    return bool(lag >= (CALM * limit if was_suspect else limit))


def _nearest(of_s: F64, t_s: F64) -> I64:
    """Rows of increasing times (m) that are nearest to some times (n)."""
    above = np.clip(np.searchsorted(of_s, t_s), 1, max(len(of_s) - 1, 1))
    below = above - 1
    above = np.minimum(above, len(of_s) - 1)
    return np.where(t_s - of_s[below] <= of_s[above] - t_s, below, above)


def _reason(
    odd: Bool, t_s: F64, end_s: float, parameters: SpoofingParameters, *, was_suspect: bool
) -> int:
    """The first reason of which too many of the frames up to then have the sign."""
    first, last = np.searchsorted(t_s, [end_s - parameters.memory_s, end_s])
    if last - first < parameters.fewest_frames:
        return 0
    shares = odd[first:last].mean(axis=0)
    limit = parameters.calm_share if was_suspect else parameters.odd_share
    too_many = np.flatnonzero(shares >= limit)
    return int(too_many[0]) + 1 if len(too_many) else 0
