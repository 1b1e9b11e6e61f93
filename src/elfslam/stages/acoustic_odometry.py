"""Acoustic odometry: how long the walker's steps really are, told by the echoes of the walls.

Sound measures in metres, dead reckoning only in steps. While the phone moves by p, the echo of a
wall that faces direction u arrives 2 u.p earlier, whatever the wall. So the frames of a few seconds
are added up along the delays that a wall at every direction and distance would give (a Hough
transform, with the claimed moves stretched by a trial scale): where the stretch is right the echoes
of real walls pile up, where it is wrong they smear. The stretch of the sharpest picture is the
ratio of true to claimed distance, one number per walk. It has no need of walls ahead: a turn shows
the same wall from two directions of walking.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import ndimage, signal

from elfslam.base.arrays import F32, F64
from elfslam.base.parameters import parameter
from elfslam.base.values import ECHO_RATE_HZ, Chirp, Echoes, Odometry

SAMPLES_PER_BIN = 4
"""Delays are kept in bins of 3 cm of path, half of what 5 kHz of band resolve (c / B = 7 cm)."""
SCALE_STEP = 0.02
"""Between the trial scales; a parabola finds the peak between them."""
BRIGHTEST = 4.0
"""Standard deviations; one very loud echo counts no more than this."""
AROUND_BINS = 21
"""Loudness is measured against that of 0.65 m of path around."""
TINY = float(np.finfo(np.float64).tiny)
RESAMPLES = 200
"""Bootstrap over the windows: the scatter is known to 5 %."""
ALIKE_WINDOWS = 1.5
"""What windows share, such as how a phone swings, no drawing of windows shows: errors of walks are
so many times their scatter."""


@dataclass(frozen=True)
class AcousticOdometryParameters:
    """How the walk is cut, which scales are tried, and what is refused."""

    window_s: float = parameter(6.0, "s", "length of walk in one picture", 0.5, 60.0)
    directions: int = parameter(48, "", "directions of walls that are tried", 8, 720)
    smallest_scale: float = parameter(0.74, "", "smallest true over claimed distance", 0.1, 1.0)
    largest_scale: float = parameter(1.34, "", "largest true over claimed distance", 1.0, 10.0)
    least_speed_mps: float = parameter(0.6, "m/s", "slower windows are left out", 0.05, 3.0)
    least_windows: int = parameter(4, "", "fewer windows are refused", 2, 1000)
    least_contrast: float = parameter(
        0.12, "", "logarithm of the best sharpness over the usual that is wanted", 0.0, 10.0
    )
    most_scatter: float = parameter(
        0.08, "", "windows that disagree more on the scale are refused", 0.001, 1.0
    )
    model_sigma: float = parameter(
        0.01, "", "error of the speed of sound and of the model, relative", 0.0, 0.2
    )
    sound_mps: float = parameter(343.2, "m/s", "speed of sound; that of 20 degrees C", 300.0, 380.0)
    ahead_s: float = parameter(
        0.040, "s", "a sweep hears ranges as they will be so much later", 0.0, 0.2
    )


@dataclass(frozen=True)
class ScaleEstimate:
    """True over claimed distance and its standard error; (1, infinite) where the sound is mute."""

    scale: float
    sigma: float


UNKNOWN = ScaleEstimate(1.0, float("inf"))


class ScaleEvidence(NamedTuple):
    """Trial scales (k) and, for each window (w, k), how sharp the picture is: a logarithm."""

    scales: F64
    sharpness: F64


def measure_scale(
    echoes: Echoes, odometry: Odometry, chirp: Chirp, parameters: AcousticOdometryParameters
) -> ScaleEstimate:
    """True over claimed distance of a walk, from its sound alone; UNKNOWN where it cannot tell.

    Refused are walks of too few windows, pictures that are no sharper at any scale or sharpest at
    the end of the range, and windows that contradict each other. The standard error is that of a
    bootstrap over windows, widened by what they share, on top of `model_sigma`.
    """
    scales, sharpness = scale_evidence(echoes, odometry, chirp, parameters)
    if len(sharpness) < parameters.least_windows:
        return UNKNOWN
    overall = sharpness.mean(axis=0)
    scale, scatter = _peak(scales, overall), float(np.std(_bootstrapped(scales, sharpness)))
    inside = scales[0] < scale < scales[-1]
    contrast = overall.max() - np.median(overall)
    if not inside or contrast < parameters.least_contrast or scatter > parameters.most_scatter:
        return UNKNOWN
    return ScaleEstimate(
        scale, float(np.hypot(ALIKE_WINDOWS * scatter, parameters.model_sigma * scale))
    )


def with_prior(estimate: ScaleEstimate, prior_sigma: float) -> ScaleEstimate:
    """The estimate weighed against what is known of people: scale 1 give or take `prior_sigma`."""
    measured, known = estimate.sigma**-2, prior_sigma**-2
    scale = (measured * estimate.scale + known) / (measured + known)
    return ScaleEstimate(scale, float((measured + known) ** -0.5))


def rescaled(odometry: Odometry, estimate: ScaleEstimate) -> Odometry:
    """The walk with every step longer by the scale; it starts where it did and turns as it did."""
    poses, sigma = odometry.world_from_body.copy(), odometry.step_sigma.copy()
    poses[:, :2] = poses[0, :2] + estimate.scale * (poses[:, :2] - poses[0, :2])
    sigma[:, :2] *= estimate.scale
    return replace(odometry, world_from_body=poses, step_sigma=sigma, scale_sigma=estimate.sigma)


def scale_evidence(
    echoes: Echoes, odometry: Odometry, chirp: Chirp, parameters: AcousticOdometryParameters
) -> ScaleEvidence:
    """How sharp the walls are in every window of the walk at every trial scale."""
    span = parameters.largest_scale - parameters.smallest_scale
    scales = np.linspace(
        parameters.smallest_scale, parameters.largest_scale, round(span / SCALE_STEP) + 1
    )
    slopes = _slopes(scales, parameters)
    sharpness = [
        focus(loudness(echoes.samples[rows], chirp), slopes @ moves_m.T).reshape(len(scales), -1)
        for rows, moves_m in windows(echoes.t_s + parameters.ahead_s, odometry, parameters)
    ]
    summed = [np.log(each.sum(axis=1) + TINY) for each in sharpness]
    return ScaleEvidence(scales, np.array(summed).reshape(-1, len(scales)))


def loudness(samples: F32, chirp: Chirp) -> F32:
    """How loud each delay is in each frame (n, bins), against its own mean over the frames.

    In standard deviations of the delays around. What moves along with the phone, such as its
    holder, floor and ceiling, is the same in all frames and leaves with the mean.
    """
    played = chirp.samples.astype(np.float64)
    if chirp.rate_hz != ECHO_RATE_HZ:
        played = signal.resample(played, round(len(played) * ECHO_RATE_HZ / chirp.rate_hz))
    kernel = np.conj(signal.hilbert(played)[::-1]).astype(np.complex64)[None, :]
    envelope = np.abs(signal.oaconvolve(samples, kernel, mode="valid", axes=1))
    bins = envelope.shape[1] // SAMPLES_PER_BIN
    cut = envelope[:, : bins * SAMPLES_PER_BIN].reshape(len(envelope), bins, SAMPLES_PER_BIN)
    varying = cut.mean(axis=2) - cut.mean(axis=(0, 2))
    around = ndimage.uniform_filter1d((varying**2).mean(axis=0), AROUND_BINS, mode="nearest")
    return np.asarray(np.clip(varying / np.sqrt(around + 1e-30), -BRIGHTEST, BRIGHTEST), np.float32)


def _slopes(scales: F64, parameters: AcousticOdometryParameters) -> F64:
    """Bins by which echoes come earlier for a metre of claimed move (scales * directions, 2)."""
    angle = np.linspace(0.0, 2 * np.pi, parameters.directions, endpoint=False)
    towards = np.column_stack([np.cos(angle), np.sin(angle)])
    bins_per_m = 2.0 / parameters.sound_mps * ECHO_RATE_HZ / SAMPLES_PER_BIN
    return np.asarray((bins_per_m * scales[:, None, None] * towards).reshape(-1, 2))


def windows(
    t_s: F64, odometry: Odometry, parameters: AcousticOdometryParameters
) -> Iterator[tuple[slice, F64]]:
    """Rows of the frames of each window that is walked, and its moves (n, 2) from the middle."""
    poses, times = odometry.world_from_body, odometry.t_s
    xy_m = np.column_stack([np.interp(t_s, times, poses[:, k]) for k in range(2)])
    first, last = np.searchsorted(t_s, [times[0], times[-1]])
    period_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    count = max(round(parameters.window_s / period_s), 2)
    for start in range(first, last - count + 1, count):
        rows = slice(start, start + count)
        walked_m = np.linalg.norm(np.diff(xy_m[rows], axis=0), axis=1).sum()
        if walked_m > parameters.least_speed_mps * (t_s[rows][-1] - t_s[rows][0]):
            yield rows, xy_m[rows] - xy_m[rows].mean(axis=0)


def focus(loud: F32, earlier: F64) -> F64:
    """Sharpness (k) of the pile of frames `loud` (n, bins), shifted `earlier` (k, n) bins.

    The fourth powers of what piles up at each delay: few strong walls outdo much weak clutter.
    """
    later = np.floor(earlier + 0.5).astype(np.int64)
    reach = int(np.abs(later).max())
    return np.asarray(_pile(loud, later + reach, np.zeros(loud.shape[1] + 2 * reach, np.float32)))


@njit(cache=True, fastmath=True, nogil=True)
def _pile(loud, first, pile):  # type: ignore[no-untyped-def]
    sharpness = np.zeros(len(first))
    for k in range(len(first)):
        pile[:] = 0.0
        for n in range(loud.shape[0]):
            for b in range(loud.shape[1]):
                pile[first[k, n] + b] += loud[n, b]
        for b in range(len(pile)):
            if pile[b] > 0.0:
                sharpness[k] += pile[b] ** 4
    return sharpness


def _bootstrapped(scales: F64, sharpness: F64) -> F64:
    """The peak of windows drawn anew with replacement, again and again."""
    generator, count = np.random.default_rng(0), len(sharpness)
    weights = generator.multinomial(count, np.full(count, 1.0 / count), RESAMPLES) / count
    return np.array([_peak(scales, row) for row in weights @ sharpness])


def _peak(scales: F64, sharpness: F64) -> float:
    """Where the parabola through the highest value and its neighbours is highest."""
    k = int(np.argmax(sharpness))
    if k in (0, len(scales) - 1):
        return float(scales[k])
    before, at, after = sharpness[k - 1 : k + 2]
    offset = 0.5 * (before - after) / min(before - 2 * at + after, -1e-12)
    return float(scales[k] + offset * (scales[1] - scales[0]))
