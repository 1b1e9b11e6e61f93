"""Wi-Fi as a phone scans it: access points, path loss, walls, shadows that stay with the place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Bool, Value, array
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import WifiScans
from elfslam.world.walker import Motion

SHADOW_WAVES = 200
NEAREST_M = 0.5
"""Closer than this the power no longer rises: antennas are not points."""
SIGHTING_AGE_S = (0.7, 1.6)
"""Age of an entry that was heard in the scan itself, as in the mall walks."""
PERIOD_JITTER = 0.05


@dataclass(frozen=True, eq=False)
class AccessPoint(Value):
    """A transmitter: where it hangs, what it radiates and on which channel."""

    bssid: str
    position_m: F64 = array(3)
    power_dbm: float = 16.0
    channel: int = 6


@dataclass(frozen=True)
class WifiParameters:
    """How radio spreads, and how a phone scans for it.

    Chosen beside real mall walks: `python -m studies sensors` shows how well they agree.
    """

    scan_rate_hz: float = parameter(0.8, "Hz", "scans per second", low=0.01, high=10.0)
    exponent: float = parameter(2.8, "", "power falls with this power of distance", low=1.0)
    wall_loss_db: float = parameter(6.0, "dB", "loss in every wall crossed", low=0.0)
    body_loss_db: float = parameter(6.0, "dB", "loss through the holder, fully behind", low=0.0)
    shadowing_db: float = parameter(4.0, "dB", "standard deviation over the floor", low=0.0)
    correlation_m: float = parameter(8.0, "m", "shadowing falls to 1/e in this", low=0.1)
    fading_db: float = parameter(4.5, "dB", "standard deviation from scan to scan", low=0.0)
    threshold_dbm: float = parameter(-92.0, "dBm", "weaker beacons are not heard")
    missed_share: float = parameter(0.6, "", "missed by chance at the threshold", low=0.0, high=1.0)
    missed_halving_db: float = parameter(12.0, "dB", "so much stronger, half as many", low=0.1)
    forget_s: float = parameter(30.0, "s", "an entry not heard for so long is dropped", low=0.0)


MALL_SCANS = WifiParameters(scan_rate_hz=0.45)
"""The phone of the mall walks: a scan every 2.1 to 2.3 s, entries kept up to 30 s."""


@dataclass(frozen=True, eq=False)
class Shadowing(Value):
    """A smooth random field over the floor: a sum of waves, so that it needs no grid."""

    sigma_db: float
    waves_radpm: F64 = array("w", 2)
    phase_rad: F64 = array("w")


def channel_mhz(channel: int) -> float:
    """Centre frequency of a channel (IEEE 802.11). Raises InputError for one that is none."""
    if 1 <= channel <= 13:
        return 2407.0 + 5 * channel
    if channel == 14:
        return 2484.0
    if 36 <= channel <= 177:
        return 5000.0 + 5 * channel
    raise InputError(f"channel {channel}: wanted 1 to 14 or 36 to 177; correct it")


def random_shadowing(
    generator: np.random.Generator, sigma_db: float, correlation_m: float
) -> Shadowing:
    """A field whose correlation falls as exp(-distance / correlation_m) (Gudmundson 1991).

    The spectrum of that correlation in the plane is Student's t with one degree of freedom.
    """
    gauss = generator.standard_normal((SHADOW_WAVES, 2))
    waves = gauss / (correlation_m * np.abs(generator.standard_normal((SHADOW_WAVES, 1))))
    return Shadowing(sigma_db, waves, generator.uniform(0, 2 * np.pi, SHADOW_WAVES))


def shadow_db(shadowing: Shadowing, xy_m: F64) -> F64:
    """The field at points (n, 2)."""
    waves = np.cos(xy_m @ shadowing.waves_radpm.T + shadowing.phase_rad)
    scale = shadowing.sigma_db * np.sqrt(2 / len(shadowing.phase_rad))
    return np.asarray(scale * waves.sum(axis=1))


def walls_crossed(from_m: F64, to_m: F64, walls_m: F64) -> I64:
    """How many wall segments (w, 2, 2) lie between points (n, 2) and a point (2)."""
    start, end = walls_m[None, :, 0], walls_m[None, :, 1]
    here, there = from_m[:, None, :], to_m[None, None, :]
    apart = _is_left(start, end, here) != _is_left(start, end, there)
    across = _is_left(here, there, start) != _is_left(here, there, end)
    return np.asarray((apart & across).sum(axis=1))


def mean_rssi_dbm(
    point: AccessPoint, position_m: F64, walls_m: F64, parameters: WifiParameters
) -> F64:
    """Path loss law without shadows at positions (n, 3).

    Free space up to 1 m (ITU-R P.525), then the exponent, and each wall's loss.
    """
    at_1_m = point.power_dbm - 20 * np.log10(channel_mhz(point.channel)) + 27.55
    distance_m = np.linalg.norm(position_m - point.position_m, axis=1)
    spread_db = 10 * parameters.exponent * np.log10(np.maximum(distance_m, NEAREST_M))
    walls = walls_crossed(position_m[:, :2], point.position_m[:2], walls_m)
    return np.asarray(at_1_m - spread_db - parameters.wall_loss_db * walls)


def scan(
    motion: Motion,
    points: Sequence[AccessPoint],
    walls_m: F64,
    place_seed: int,
    generator: np.random.Generator,
    parameters: WifiParameters,
) -> WifiScans | None:
    """The scans of a walk; None where nothing is heard. Shadows depend on the place alone."""
    t_s = _scan_times(motion.t_s[-1], generator, parameters)
    shape = len(t_s), len(points)
    age_s = generator.uniform(*SIGHTING_AGE_S, shape)
    heard_dbm = parameters.fading_db * generator.standard_normal(shape)
    for column, point in enumerate(points):
        shadows = np.random.default_rng([place_seed, 12, column])
        shadowing = random_shadowing(shadows, parameters.shadowing_db, parameters.correlation_m)
        at = np.searchsorted(motion.t_s, t_s - age_s[:, column])
        position_m = motion.position_m[at]
        heard_dbm[:, column] += mean_rssi_dbm(point, position_m, walls_m, parameters)
        heard_dbm[:, column] += shadow_db(shadowing, position_m[:, :2])
        heard_dbm[:, column] -= parameters.body_loss_db * _behind(motion, at, point)
    heard_dbm = np.round(heard_dbm)
    above_db = heard_dbm - parameters.threshold_dbm
    missed_share = parameters.missed_share * 0.5 ** (above_db / parameters.missed_halving_db)
    missed = generator.uniform(0, 1, shape) < missed_share
    heard_dbm[missed | (heard_dbm < parameters.threshold_dbm)] = np.nan
    return _with_stale_entries(t_s, points, heard_dbm, age_s, parameters)


def _is_left(start: F64, end: F64, point: F64) -> Bool:
    """Whether the point lies left of the line; on it counts as right, so corners count once."""
    line, off = end - start, point - start
    return np.asarray(line[..., 0] * off[..., 1] > line[..., 1] * off[..., 0])


def _scan_times(end_s: float, generator: np.random.Generator, parameters: WifiParameters) -> F64:
    period_s = 1 / parameters.scan_rate_hz
    count = int(end_s / period_s) + 2
    jitter = 1 + PERIOD_JITTER * generator.uniform(-1, 1, count)
    first_s = SIGHTING_AGE_S[1] + generator.uniform(0, period_s) - period_s * (1 - PERIOD_JITTER)
    t_s = first_s + np.cumsum(period_s * jitter)
    return np.asarray(t_s[t_s < end_s])


def _behind(motion: Motion, at: I64, point: AccessPoint) -> F64:
    """0 where the holder faces the access point, 1 where it lies behind the holder's back."""
    way_m = point.position_m[:2] - motion.position_m[at, :2]
    towards = np.arctan2(way_m[:, 1], way_m[:, 0])
    return np.asarray((1 - np.cos(towards - motion.heading_rad[at])) / 2)


def _with_stale_entries(
    t_s: F64, points: Sequence[AccessPoint], heard_dbm: F64, age_s: F64, parameters: WifiParameters
) -> WifiScans | None:
    """Entries missed in a scan are repeated from the last one that heard them, until forgotten."""
    rows = np.where(np.isfinite(heard_dbm), np.arange(len(t_s))[:, None], -1)
    last = np.maximum.accumulate(rows, axis=0)
    column = np.arange(len(points))
    rssi_dbm = heard_dbm[last, column]
    age_s = age_s[last, column] + t_s[:, None] - t_s[last]
    absent = (last < 0) | (age_s > parameters.forget_s)
    rssi_dbm[absent], age_s[absent] = np.nan, np.nan
    scans, seen = ~absent.all(axis=1), ~absent.all(axis=0)
    if not seen.any():
        return None
    order = sorted(np.flatnonzero(seen).tolist(), key=lambda k: points[k].bssid)
    names = tuple(points[k].bssid for k in order)
    return WifiScans(t_s[scans], names, rssi_dbm[scans][:, order], age_s[scans][:, order])
