"""Simulated sensors beside real ones: the same statistics of simulated and of mall walks."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Recording, Truth
from elfslam.data.mall import read_walk, walks_in
from elfslam.scoring.consistency import displacement_errors
from elfslam.stages.motion import MotionParameters, dead_reckon, find_footsteps
from elfslam.world.magnetic import Magnetism, magnetic_field
from elfslam.world.materials import material
from elfslam.world.room import shoebox
from elfslam.world.sensors import Sensor, Surroundings
from elfslam.world.wifi import MALL_SCANS, AccessPoint
from elfslam.world.world_file import World, load_world
from studies.cached import simulate
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

ROOMS = ("studio", "lounge")
HALL_M = np.array([60.0, 40.0, 4.5])
HALL_ROUTE_M = np.array([[5.0, 5.0], [55.0, 5.0], [55.0, 34.0], [30.0, 20.0], [5.0, 35.0]])
MALL_M = np.array([240.0, 176.0])
HALL_ACCESS_POINTS = 900
SHOP_DEPTH_M = 10.0
STILL_S = 1.0
DISPLACEMENTS_M = (5.0, 20.0, 60.0)
WAYPOINTS_M = 6.0
WAYPOINT_SIGMA_M = 0.4
"""How far apart waypoints of the mall are, and how far off surveyors tap them, per axis."""
FRESH_S = 2.0
STALE_S = 5.0
MOST_HEARD = 150
"""Access points whose readings are compared pair by pair."""
FIELD_SPACING_M = 0.25
RSSI_LAGS_M = {"0 m": (0.0, 1.0), "2 m": (1.0, 3.0), "5 m": (4.0, 6.0), "10 m": (9.0, 11.0)}
FIELD_LAGS_M = (1.0, 2.0, 5.0)
SCENARIO_OF = {"surveyor": "surveyor", "person": "pedestrian"}
"""By simulated walker."""

Statistics = dict[tuple[str, str], float]
"""By metric and condition."""
Floor = list[tuple[Recording, Truth]]
"""Walks of one place: positions may be compared between them."""


def measure_sensors(context: StudyContext, *, walks: int = 6, mall_walks: int = 40) -> list[Record]:
    """Statistics of surveyors and pedestrians, simulated in rooms and a hall, and of the real mall.

    Nothing of the mall without `data`, a folder that holds `mall_walks/*.tar.xz`. `walks` are
    simulated in each place, and `mall_walks` read of each floor.
    """
    context.announce("reading the mall walks", None)
    records: list[Record] = []
    if context.data is not None:
        real = statistics(list(mall_floors(context.data, mall_walks)))
        records += _records(real, Record("measured", world="mall"))
    context.announce("simulating walks", None)
    for walker, scenario in SCENARIO_OF.items():
        for place, worlds in (("rooms", list(map(load_world, ROOMS))), ("hall", [hall()])):
            found = statistics([simulated_floor(world, walks, walker) for world in worlds])
            of = Record("simulated", world=place, scenario=scenario,
                        seeds=seeds_text(range(walks)))  # fmt: skip
            records += _records(found, of)
    return records


def _records(found: Statistics, of: Record) -> list[Record]:
    """Without those that do not exist: a room is smaller than some distances."""
    return [
        replace(of, metric=metric, condition=condition, value=value)
        for (metric, condition), value in found.items()
        if np.isfinite(value)
    ]


def hall() -> World:
    """A hall as large as a part of the mall, with access points all over the mall's area."""
    room = shoebox(HALL_M, (material("concrete"),) * 6)
    generator = np.random.default_rng(1)
    corner_m = (HALL_M[:2] - MALL_M) / 2
    xy_m = corner_m + MALL_M * generator.uniform(0, 1, (HALL_ACCESS_POINTS, 2))
    height_m = generator.uniform(2.5, 4.0, (HALL_ACCESS_POINTS, 1))
    points = tuple(
        AccessPoint(f"02:00:00:00:{k >> 8:02x}:{k & 255:02x}", position_m, 16.0, 1 + 5 * (k % 3))
        for k, position_m in enumerate(np.hstack([xy_m, height_m]))
    )
    field = magnetic_field(room, Magnetism(), generator)
    around = Surroundings(_shop_walls(), 1, points, field)
    return World("hall", room, HALL_ROUTE_M, around)


def _shop_walls() -> F64:
    """A wall every ten metres outside the hall (w, 2, 2), up to the mall's outline."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    rings = [
        corners * (HALL_M[:2] + 2 * out_m) - out_m
        for out_m in np.arange(0.0, MALL_M.max() / 2, SHOP_DEPTH_M)
    ]
    return np.vstack([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])


def statistics(floors: Sequence[Floor]) -> Statistics:
    """Everything measured of some floors."""
    recordings = [recording for floor in floors for recording, _ in floor]
    walks = [walk for floor in floors for walk in floor]
    return {
        ("walks", ""): float(len(walks)),
        **_gait(recordings),
        **_reckoning(walks),
        **_scans(recordings),
        **_rssi(floors),
        **_field(walks),
    }


def simulated_floor(world: World, walks: int, kind: str) -> Floor:
    """So many walks by a walker of a kind, with the truth as surveyors give it."""
    sensors, rounds = (Sensor.WIFI, Sensor.MAGNETIC), 1 if world.name == "hall" else 4
    floor = []
    for seed in range(walks):
        recording, truth = simulate(
            world, seed, rounds=rounds, walker=kind, sound=False, sensors=sensors, wifi=MALL_SCANS
        )
        floor.append((recording, as_tapped(truth, np.random.default_rng(seed))))
    return floor


def mall_floors(data: Path, count: int) -> Iterator[Floor]:
    """The first walks of each floor of the mall. Raises InputError without them."""
    archives = sorted((data / "mall_walks").glob("*.tar.xz"))
    if not archives:
        raise InputError(f"{data}: holds no mall_walks/*.tar.xz; wanted the real mall walks")
    for archive in archives:
        walks = [read_walk(path) for path in islice(walks_in(archive), count)]
        yield [
            (walk.recording, truth)
            for walk in walks
            if (truth := walk.truth) and len(truth.t_s) > 1
        ]


def _gait(recordings: Sequence[Recording]) -> Statistics:
    rates, uneven, peaks, gyro, turning = [], [], [], [], []
    for recording in recordings:
        imu = recording.imu
        assert imu is not None
        footsteps_t_s = find_footsteps(imu, MotionParameters())
        rates.append(1 / np.median(np.diff(footsteps_t_s)))
        uneven.append(unevenness(footsteps_t_s))
        strength = np.linalg.norm(imu.accel_mps2, axis=1)
        peaks.append(np.percentile(strength, 99) - np.median(strength))
        size = int(np.searchsorted(imu.t_s, imu.t_s[0] + STILL_S))
        starts = range(0, len(imu.t_s) - size, size // 2)
        seconds = [imu.gyro_radps[k : k + size].std(axis=0).mean() for k in starts]
        gyro.append(min(seconds))
        turning.append(np.median(seconds))
    return {
        ("step rate (Hz)", ""): float(np.median(rates)),
        ("scatter of step intervals (share)", ""): float(np.median(uneven)),
        ("acceleration above rest, 99th percentile (m/s2)", ""): float(np.median(peaks)),
        ("gyroscope scatter (rad/s)", "quietest second"): float(np.median(gyro)),
        ("gyroscope scatter (rad/s)", "median second"): float(np.median(turning)),
    }


def unevenness(footsteps_t_s: F64) -> float:
    """Scatter of the intervals between steps, as a share of their median.

    By the middle two thirds of the differences between one interval and the next, which neither
    pauses nor a changing pace widen.
    """
    intervals_s = np.diff(footsteps_t_s)
    low, high = np.percentile(np.diff(intervals_s) / np.sqrt(2), (16, 84))
    return float((high - low) / 2 / np.median(intervals_s))


def _reckoning(walks: Sequence[tuple[Recording, Truth]]) -> Statistics:
    """Root mean square errors of displacements by dead reckoning, along and across the way."""
    reckoned = [
        (dead_reckon(recording.imu, MotionParameters()), truth)
        for recording, truth in walks
        if recording.imu is not None
    ]
    found: Statistics = {}
    for far_m in DISPLACEMENTS_M:
        errors = [displacement_errors(odometry, truth, far_m) for odometry, truth in reckoned]
        error_m = np.vstack([one.error_m for one in errors])
        for axis, way in enumerate(("along", "across")):
            rms_m = _mean(error_m[:, axis] ** 2) ** 0.5
            found[f"displacement error {way} (m)", f"{far_m:g} m"] = rms_m
    return found


def as_tapped(truth: Truth, generator: np.random.Generator) -> Truth:
    """Truth as surveyors give it: waypoints on the way, each tapped a little off."""
    poses = truth.world_from_body
    walked_m = np.cumsum(
        np.linalg.norm(np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2]), axis=1)
    )
    rows = np.flatnonzero(np.diff((walked_m / WAYPOINTS_M).astype(int), prepend=-1))
    xy_m = poses[rows, :2] + generator.normal(0.0, WAYPOINT_SIGMA_M, (len(rows), 2))
    return Truth(truth.t_s[rows], np.column_stack([xy_m, np.full(len(rows), np.nan)]))


def _scans(recordings: Sequence[Recording]) -> Statistics:
    scans = [recording.wifi for recording in recordings if recording.wifi is not None]
    seen = [np.isfinite(wifi.rssi_dbm) for wifi in scans]
    ages = np.concatenate([wifi.age_s[k] for wifi, k in zip(scans, seen, strict=True)])
    rssi = np.concatenate([wifi.rssi_dbm[k] for wifi, k in zip(scans, seen, strict=True)])
    entries = np.concatenate([k.sum(axis=1) for k in seen])
    return {
        ("time between scans (s)", ""): float(
            np.median(np.concatenate([np.diff(wifi.t_s) for wifi in scans]))
        ),
        ("access points in a scan", ""): float(np.median(entries)),
        ("stale scan entries (share)", ""): float((ages > STALE_S).mean()),
        ("RSSI (dBm)", "median"): float(np.median(rssi)),
        ("RSSI (dBm)", "95th percentile"): float(np.percentile(rssi, 95)),
    }


def _rssi(floors: Sequence[Floor]) -> Statistics:
    """Half the mean square difference of two readings of one access point, by distance."""
    squares: dict[str, list[F64]] = {name: [] for name in RSSI_LAGS_M}
    residuals = []
    for floor in floors:
        for xy_m, rssi_dbm in _readings_by_access_point(floor):
            first, second = np.triu_indices(len(rssi_dbm), 1)
            apart_m = np.linalg.norm(xy_m[first] - xy_m[second], axis=1)
            half = (rssi_dbm[first] - rssi_dbm[second]) ** 2 / 2
            residuals.append(rssi_dbm - rssi_dbm.mean())
            for name, (low_m, high_m) in RSSI_LAGS_M.items():
                squares[name].append(half[(apart_m >= low_m) & (apart_m < high_m)])
    spread = {name: _mean(np.concatenate(some)) for name, some in squares.items()}
    total = float(np.mean(np.concatenate(residuals) ** 2))
    return {
        **{("RSSI spread (dB)", lag): half**0.5 for lag, half in spread.items()},
        ("RSSI spread (dB)", "whole walks"): total**0.5,
    }


def _mean(values: F64) -> float:
    """NaN where there is nothing: a room is smaller than some distances."""
    return float(values.mean()) if len(values) else float("nan")


def _readings_by_access_point(floor: Floor) -> list[tuple[F64, F64]]:
    """Positions (n, 2) and RSSI (n) of fresh readings of the access points heard most."""
    names, rows = [], []
    for recording, truth in floor:
        wifi = recording.wifi
        if wifi is None:
            continue
        with np.errstate(invalid="ignore"):
            scan, column = np.nonzero(np.isfinite(wifi.rssi_dbm) & (wifi.age_s < FRESH_S))
        heard_s = wifi.t_s[scan] - wifi.age_s[scan, column]
        rows.append(np.column_stack([_at(truth, heard_s), wifi.rssi_dbm[scan, column]]))
        names.append(np.array(wifi.bssids)[column])
    if not rows:
        return []
    which = np.unique(np.concatenate(names), return_inverse=True)[1]
    table = np.vstack(rows)
    busiest = np.argsort(np.bincount(which))[-MOST_HEARD:]
    return [(table[which == k, :2], table[which == k, 2]) for k in busiest]


def _field(walks: Sequence[tuple[Recording, Truth]]) -> Statistics:
    """Field magnitude by distance walked, without the mean of the walk."""
    profiles, means = [], []
    for recording, truth in walks:
        sensor = recording.magnetometer
        if sensor is None:
            continue
        profile = _by_distance(sensor.t_s, np.linalg.norm(sensor.field_ut, axis=1), truth)
        means.append(profile.mean())
        profiles.append(profile - profile.mean())
    total = float(np.mean(np.concatenate(profiles) ** 2))
    lags = {lag_m: round(lag_m / FIELD_SPACING_M) for lag_m in FIELD_LAGS_M}
    half = {
        lag_m: np.concatenate([(some[lag:] - some[:-lag]) ** 2 / 2 for some in profiles])
        for lag_m, lag in lags.items()
    }
    return {
        ("magnetic field, mean (uT)", ""): float(np.mean(means)),
        ("magnetic field, spread between walks (uT)", ""): float(np.std(means)),
        ("magnetic field, spread along a walk (uT)", ""): total**0.5,
        **{
            ("magnetic field correlation", f"{lag_m:g} m"): 1 - float(np.mean(some)) / total
            for lag_m, some in half.items()
        },
    }


def _by_distance(t_s: F64, values: F64, truth: Truth) -> F64:
    """Values at every quarter metre walked, each the mean around it."""
    inside = (t_s >= truth.t_s[0]) & (t_s <= truth.t_s[-1])
    xy_m = _at(truth, t_s[inside])
    moves_m = np.linalg.norm(np.diff(xy_m, axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(moves_m)])
    cell = np.round(walked_m / FIELD_SPACING_M).astype(int)
    counts = np.bincount(cell)
    means = np.bincount(cell, weights=values[inside])[counts > 0] / counts[counts > 0]
    return np.interp(np.arange(len(counts)), np.flatnonzero(counts), means)


def _at(truth: Truth, t_s: F64) -> F64:
    return np.column_stack(
        [np.interp(t_s, truth.t_s, truth.world_from_body[:, k]) for k in range(2)]
    )


STUDY = Study(
    "Do simulated sensors read what real ones read?",
    measure_sensors, minutes=8, data=("mall_walks",), fast={"walks": 1, "mall_walks": 3},
)  # fmt: skip
