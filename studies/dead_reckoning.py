"""How far dead reckoning leads astray: on all walks of two mall floors, and on simulated ones."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose, path_length_m, wrap_angle
from elfslam.base.values import Announce, Imu, Magnetometer, Odometry, Truth
from elfslam.data.mall import read_walk, walks_in
from elfslam.scoring.consistency import displacement_errors
from elfslam.scoring.errors import (
    Alignment,
    end_error_share,
    interval,
    match,
    placement,
)
from elfslam.stages.motion import (
    HardIron,
    MotionParameters,
    calibrated_by_distance,
    compass_heading,
    dead_reckon,
    half_turned,
    missed_half_turn,
)
from elfslam.world.device import BMI160, BROWSER
from elfslam.world.imu import read_imu
from elfslam.world.simulate import load_world
from elfslam.world.walker import (
    TYPICAL_CADENCE_HZ,
    TYPICAL_SPEED_MPS,
    Walker,
    random_walker,
)
from elfslam.world.walker import (
    walk as walk_laps,
)
from studies.cached import simulate
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

WORLDS = ("studio", "lounge", "concourse")
"""None of the worlds that are for evaluation: motion was developed on these."""
FIRST_SEED = 100
SEEDS = 6
ROUNDS = 2
DISTANCES_M = (5.0, 20.0, 60.0)
WAYPOINT_SIGMA_M = 0.4
"""How far surveyors tap a waypoint from where they are, per axis: consecutive legs of a walk err
against each other by so much."""
TRUE_LEG, UNTURNED, COMPASS, COMPASS_KNOWN, ROTATION = (
    "first leg of the truth",
    "compass, this walk alone, no angle of the floor (elfslam map)",
    "compass, this walk alone",
    "compass, phone known from the walks before",
    "rotation vector of the phone",
)
LENGTH_KNOWN = f"{TRUE_LEG}, length known"
AS_HELD = "50 Hz, as held"
DEAD_RECKONING = "dead reckoning"
LENGTHS = {
    "bounce and walk ratio": MotionParameters(),
    "bounce alone": replace(MotionParameters(), walk_ratio_sigma=10.0),
}
LENGTH_ERROR, LENGTH_BIAS, LENGTH_SPREAD = (
    "path length error (%)", "path length bias (%)", "path length spread (%)",
)  # fmt: skip
MAGNETOMETER = "magnetometer"
TURN_TOLD, TURN_NEAR, TURN_FALSE = (
    "missed half turn told (%)", "told within 5 s (%)", "told where none is missed (%)",
)  # fmt: skip
SLOW, SLOW_WALKERS, SLOW_RATE_HZ = "slow walkers", 20, 50.0
HALL_M = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 12.0], [0.0, 12.0]])
WALK_RATIO_M_PER_HZ, WALK_RATIO_SPREAD = 0.384, 0.08
"""Of adults (Sekiya and Nagasaki 1998): 0.0064 m per step a minute."""
LEG_M, PASSED_ON = 0.9, (0.5, 0.9)
"""A leg as inverted pendulum raises the body by step^2 / 8 leg; a hand passes so much of it on."""


@dataclass(frozen=True)
class ReckonedWalk:
    """One walk: its sensors and its truth, and the direction that the phone itself reports."""

    name: str
    imu: Imu
    truth: Truth
    magnetometer: Magnetometer | None = None
    reported_rad: float = float("nan")


def measure_dead_reckoning(
    context: StudyContext,
    *,
    walks: int | None = None,
    seeds: int = SEEDS,
    worlds: Sequence[str] = WORLDS,
) -> list[Record]:
    """End errors by source of the heading (the method) and by how the phone is held or sampled.

    Beside them what of an error is due to what, and whether the reported sigmas are right. Without
    `data`, which has the mall walks, simulated walks alone are measured. `walks` takes the first of
    each floor alone, `seeds` so many walks of each simulated world.
    """
    floors = (
        {} if context.data is None else dict(mall_floors(context.data, walks, context.announce))
    )
    context.announce("simulated walks", 0.5)
    records: list[Record] = []
    simulated: list[ReckonedWalk] = []
    drawn = seeds_text(range(FIRST_SEED, FIRST_SEED + seeds))
    for world, rate_hz, some in simulated_walks(worlds, seeds):
        simulated += some
        of = Record(TRUE_LEG, world=world, condition=f"{rate_hz} Hz", seeds=drawn)
        records.append(_summed_up(of, _scored(some, TRUE_LEG)))
        records.append(_summed_up(replace(of, method=LENGTH_KNOWN), _calibrated(some)))
    context.announce("mall walks", 0.6)
    records += _of_floors(floors) if floors else []
    context.announce("uncertainty", 0.9)
    for name, some in floors.items():
        records += _error_sources(name, some)
        records += _consistency(Record(DEAD_RECKONING, world=name), some, WAYPOINT_SIGMA_M)
    crowds = {**floors, "mall": [walk for some in floors.values() for walk in some]}
    crowds = {
        **(crowds if floors else {}),
        SLOW: list(slow_walks(range(FIRST_SEED, FIRST_SEED + SLOW_WALKERS))),
    }
    for name, some in crowds.items():
        records += _step_lengths(name, some)
    for name, some in floors.items():
        records += _half_turns(name, some)
    of = Record(DEAD_RECKONING, world="simulated", seeds=drawn)
    return [*records, *_consistency(of, simulated, 0.0)]


def _of_floors(floors: Mapping[str, Sequence[ReckonedWalk]]) -> Iterator[Record]:
    """By each way to know the heading, and by each way to hold or sample the phone."""
    for heading in (UNTURNED, COMPASS, COMPASS_KNOWN, ROTATION, TRUE_LEG):
        yield from _by_floor(heading, AS_HELD, floors, partial(_scored, heading=heading))
    for name, change in CHANGES.items():
        changed = {floor: [change(walk) for walk in walks] for floor, walks in floors.items()}
        score = partial(_scored, heading=COMPASS_KNOWN)
        yield from _by_floor(COMPASS_KNOWN, name, changed, score)
    yield from _by_floor(LENGTH_KNOWN, AS_HELD, floors, _calibrated)


def _by_floor(
    heading: str,
    sensors: str,
    floors: Mapping[str, Sequence[ReckonedWalk]],
    score: Callable[[Sequence[ReckonedWalk]], list[float]],
) -> Iterator[Record]:
    """For every floor, and for all walks together."""
    together: list[float] = []
    for floor, walks in floors.items():
        scored = score(walks)
        together += scored
        yield _summed_up(Record(heading, world=floor, condition=sensors), scored)
    yield _summed_up(Record(heading, world="mall", condition=sensors), together)


def _summed_up(of: Record, ends: Sequence[float]) -> Record:
    """The median of end errors, as shares, and its interval over walks."""
    each = [np.array([100 * end]) for end in ends]
    low, high = interval(each, lambda values: float(np.median(values)), np.random.default_rng(0))
    middle = 100 * float(np.median(ends))
    return replace(of, metric="end error (%)", value=middle, low=low, high=high)


def _scored(walks: Sequence[ReckonedWalk], heading: str) -> list[float]:
    """End errors as shares of every walk, its start known, its heading from one of the sources.

    Where that is the phone, one angle per floor turns north into the plane of the truth: the
    median over the floor's walks of what turns each best onto its truth; or none does.
    """
    reckoned = [dead_reckon(walk.imu, MotionParameters()) for walk in walks]
    if heading == TRUE_LEG:
        return [
            end_error_share(o.t_s, o.world_from_body, walk.truth)
            for o, walk in zip(reckoned, walks, strict=True)
        ]
    starts = _starts_rad(walks, heading)
    turn_rad = 0.0 if heading == UNTURNED else _floor_turn_rad(reckoned, walks, starts)
    return list(_ends(reckoned, walks, starts + turn_rad))


def _starts_rad(walks: Sequence[ReckonedWalk], heading: str) -> F64:
    """Heading (n) of every walk at its first footstep, against north, by the phone itself.

    Walks are taken in the order of their names, which is that of their recording.
    """
    if heading == ROTATION:
        return np.array([walk.reported_rad for walk in walks])
    known: HardIron | None = None
    found = np.zeros(len(walks))
    for k in sorted(range(len(walks)), key=lambda k: walks[k].name):
        magnetometer = walks[k].magnetometer
        assert magnetometer is not None
        compass = compass_heading(walks[k].imu, magnetometer, MotionParameters(), known)
        known = compass.hard_iron if heading == COMPASS_KNOWN else None
        found[k] = compass.heading_rad
    return found


def _floor_turn_rad(
    reckoned: Sequence[Odometry], walks: Sequence[ReckonedWalk], starts_rad: F64
) -> float:
    """The angle between north and the plane of the truth, one for all walks of a floor."""
    fitted = [
        placement(match(o.t_s, o.world_from_body, walk.truth), Alignment.ALIGNED).world_from_map[2]
        for o, walk in zip(reckoned, walks, strict=True)
    ]
    turns = np.asarray(fitted) - starts_rad
    middle = float(np.angle(np.exp(1j * turns).mean()))
    return middle + float(np.median(wrap_angle(turns - middle)))


def _ends(
    reckoned: Sequence[Odometry], walks: Sequence[ReckonedWalk], headings_rad: F64
) -> Iterator[float]:
    """End error of every walk as a share of its true path, its start and heading given."""
    for odometry, walk, heading_rad in zip(reckoned, walks, headings_rad, strict=True):
        yield end_errors(*_headed(odometry, walk, heading_rad))["as it is"]


def _headed(odometry: Odometry, walk: ReckonedWalk, heading_rad: float) -> tuple[F64, F64]:
    """A walk (n, 2) with this heading at its first footstep, and where it truly was."""
    matched = match(odometry.t_s, odometry.world_from_body, walk.truth)
    moved = compose(np.array([0.0, 0.0, heading_rad]), matched.estimate)
    return moved[:, :2], matched.truth[:, :2]


def _error_sources(floor: str, walks: Sequence[ReckonedWalk]) -> Iterator[Record]:
    """Median end errors by compass, with one thing after the other replaced by the truth."""
    reckoned = [dead_reckon(walk.imu, MotionParameters()) for walk in walks]
    starts = _starts_rad(walks, COMPASS_KNOWN)
    headings = starts + _floor_turn_rad(reckoned, walks, starts)
    found = [
        end_errors(*_headed(odometry, walk, heading_rad))
        for odometry, walk, heading_rad in zip(reckoned, walks, headings, strict=True)
    ]
    for name in found[0]:
        left = 100 * float(np.median([one[name] for one in found]))
        yield Record(name, "end error (%)", left, world=floor, condition=AS_HELD)


def end_errors(estimate_m: F64, true_m: F64) -> dict[str, float]:
    """End errors as shares of the true path, by what was replaced by the truth.

    Both walks (n, 2) are given at the true positions, the estimate with its heading from the phone.
    Legs are the moves from one true position to the next.
    """
    estimate, true = (np.diff(xy_m @ np.array([1, 1j])) for xy_m in (estimate_m, true_m))
    length_m, walked_m = np.abs(true).sum(), np.abs(estimate).sum()
    ahead = estimate / np.maximum(np.abs(estimate), 1e-9)
    scale = length_m / max(float(walked_m), 1e-9)
    turn = np.exp(1j * np.angle(np.vdot(estimate, true)))
    towards = true / np.maximum(np.abs(true), 1e-9)
    replaced = {
        "as it is": estimate,
        "true whole length": scale * estimate,
        "true length of every leg": np.abs(true) * ahead,
        "true heading of the whole walk": turn * estimate,
        "true direction of every leg": np.abs(estimate) * towards,
        "true directions of legs and whole length": scale * np.abs(estimate) * towards,
    }
    return {name: float(abs(legs.sum() - true.sum()) / length_m) for name, legs in replaced.items()}


def _calibrated(walks: Sequence[ReckonedWalk]) -> list[float]:
    """The same by a walker whose step length is known from the length of that same walk."""
    scored = []
    for walk in walks:
        odometry = dead_reckon(walk.imu, MotionParameters())
        matched = match(odometry.t_s, odometry.world_from_body, walk.truth)
        share = path_length_m(matched.truth[:, :2]) / path_length_m(matched.estimate[:, :2])
        moves_m = path_length_m(odometry.world_from_body[:, :2])
        own = calibrated_by_distance(walk.imu, share * moves_m, MotionParameters())
        taught = dead_reckon(walk.imu, own)
        scored.append(end_error_share(taught.t_s, taught.world_from_body, walk.truth))
    return scored


def _step_lengths(world: str, walks: Sequence[ReckonedWalk]) -> Iterator[Record]:
    """How far paths are from their true lengths, by bounce and walk ratio or by bounce alone."""
    for method, parameters in LENGTHS.items():
        shares = np.array([100 * length_error(walk, parameters) for walk in walks])
        of = Record(method, LENGTH_ERROR, world=world)
        yield replace(_summed_up(of, np.abs(shares) / 100), metric=LENGTH_ERROR)
        yield replace(of, metric=LENGTH_BIAS, value=float(np.median(shares)))
        yield replace(of, metric=LENGTH_SPREAD, value=float(np.std(shares)))


def _half_turns(floor: str, walks: Sequence[ReckonedWalk]) -> Iterator[Record]:
    """How often a half turn planted into the gyroscope of the middle half of a walk is told."""
    generator = np.random.default_rng(FIRST_SEED)
    found = np.array([_told_turns(walk, generator.uniform(0.25, 0.75)) for walk in walks])
    of = Record(MAGNETOMETER, world=floor, condition=AS_HELD)
    for metric, told in zip((TURN_TOLD, TURN_NEAR, TURN_FALSE), 100.0 * found.T, strict=True):
        each = [np.array([share]) for share in told]
        low, high = interval(each, lambda shares: float(shares.mean()), np.random.default_rng(0))
        yield replace(of, metric=metric, value=float(told.mean()), low=low, high=high)


def _told_turns(walk: ReckonedWalk, share: float) -> tuple[bool, bool, bool]:
    """Whether a half turn after that share of a walk is told, within 5 s, and one never planted."""
    if walk.magnetometer is None:
        return False, False, False
    at_s, known = float(np.quantile(walk.imu.t_s, share)), MotionParameters()
    told_s = missed_half_turn(half_turned(walk.imu, at_s), walk.magnetometer, known)
    as_it_is_s = missed_half_turn(walk.imu, walk.magnetometer, known)
    is_near = told_s is not None and abs(told_s - at_s) <= 5.0
    return told_s is not None, is_near, as_it_is_s is not None


def length_error(walk: ReckonedWalk, parameters: MotionParameters) -> float:
    """How much longer than its truth a path is reckoned, as a share."""
    odometry = dead_reckon(walk.imu, parameters)
    matched = match(odometry.t_s, odometry.world_from_body, walk.truth)
    begin, end = (int(np.searchsorted(odometry.t_s, each)) for each in matched.t_s[[0, -1]])
    reckoned_m = path_length_m(odometry.world_from_body[begin : end + 1, :2])
    return reckoned_m / path_length_m(matched.truth[:, :2]) - 1


def _consistency(
    of: Record, walks: Sequence[ReckonedWalk], truth_sigma_m: float
) -> Iterator[Record]:
    """Normalised errors of displacements by distance, all walks together.

    A small room has no displacement over sixty metres.
    """
    reckoned = [dead_reckon(walk.imu, MotionParameters()) for walk in walks]
    for distance_m in DISTANCES_M:
        found = [
            displacement_errors(odometry, walk.truth, distance_m, truth_sigma_m)
            for odometry, walk in zip(reckoned, walks, strict=True)
        ]
        error, sigma = (
            np.vstack([getattr(one, key) for one in found]) for key in ("error_m", "sigma_m")
        )
        if not len(error):
            continue
        numbers = {"NEES": float(np.mean(np.concatenate([one.nees for one in found])))}
        for axis, way in enumerate(("along", "across")):
            within = np.abs(error[:, axis]) / sigma[:, axis]
            numbers |= {
                f"displacement error {way} (m)": _rms(error[:, axis]),
                f"reported sigma {way} (m)": _rms(sigma[:, axis]),
                f"within one sigma, {way}": float(np.mean(within < 1)),
                f"within two sigma, {way}": float(np.mean(within < 2)),
            }
        yield from replace(of, condition=f"{distance_m:g} m").each(numbers)


def _rms(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2)))


# --- walks ---


def mall_floors(
    data: Path, count: int | None, announce: Announce
) -> Iterator[tuple[str, list[ReckonedWalk]]]:
    """Every floor by name with its walks, at most `count`. Raises InputError without data."""
    archives = sorted((data / "mall_walks").glob("*.tar.xz"))
    if not archives:
        raise InputError(f"{data}: holds no mall_walks/*.tar.xz; wanted the real mall walks")
    for k, archive in enumerate(archives):
        name = "mall " + archive.name.removesuffix(".tar.xz").removeprefix("site1-")
        announce(f"reading {name}", 0.25 * k)
        yield name, [walk for path in islice(walks_in(archive), count) for walk in _read(path)]


def _read(path: Path) -> list[ReckonedWalk]:
    """The walk of a file, if it has a truth to compare with."""
    found = read_walk(path)
    recording, truth = found.recording, found.truth
    if recording.imu is None or recording.orientation is None:
        return []
    if truth is None or len(truth.t_s) < 2:
        return []
    attitude = Rotation.from_quat(recording.orientation.world_from_phone)
    top = attitude.apply([0.0, 1.0, 0.0])
    reported = np.interp(
        recording.imu.t_s, recording.orientation.t_s, np.unwrap(np.arctan2(top[:, 1], top[:, 0]))
    )
    turned = _heading_of(recording.imu)
    mean_rad = float(np.angle(np.exp(1j * (reported - turned)).mean()))
    return [ReckonedWalk(recording.name, recording.imu, truth, recording.magnetometer, mean_rad)]


def _heading_of(imu: Imu) -> F64:
    """Heading (n), rad, at the sensors' times; 0 at the first footstep."""
    odometry = dead_reckon(imu, MotionParameters())
    return np.interp(imu.t_s, odometry.t_s, np.unwrap(odometry.world_from_body[:, 2]))


def simulated_walks(
    worlds: Sequence[str], seeds: int
) -> Iterator[tuple[str, int, list[ReckonedWalk]]]:
    """Walks of every world by both motion sensors: its name, the rate, the walks."""
    for name in worlds:
        world = load_world(name)
        for grade in (BMI160, BROWSER):
            some = []
            for seed in range(FIRST_SEED, FIRST_SEED + seeds):
                recording, truth = simulate(world, seed, rounds=ROUNDS, sound=False, grade=grade)
                if recording.imu is not None:
                    some.append(ReckonedWalk(f"{name} {seed}", recording.imu, truth))
            yield name, round(grade.rate_hz), some


def slow_walks(seeds: Sequence[int]) -> Iterator[ReckonedWalk]:
    """Slow walkers along a hall: their walk ratio is the population's, and a hand takes of the
    bounce of an inverted pendulum what it likes."""
    for seed in seeds:
        generator = np.random.default_rng([seed, 1])
        walker = slow_walker(generator)
        motion = walk_laps(walker, HALL_M, 1, generator)
        truth = Truth(motion.t_s, np.column_stack([motion.position_m[:, :2], motion.yaw_rad]))
        imu = read_imu(motion, replace(BMI160, rate_hz=SLOW_RATE_HZ), generator)
        yield ReckonedWalk(f"{SLOW} {seed}", imu, truth)


def slow_walker(generator: np.random.Generator) -> Walker:
    """Someone at 0.8 to 1.1 m/s: cadence by a walk ratio drawn as gait studies found it."""
    speed_mps = generator.uniform(0.8, 1.1)
    ratio = WALK_RATIO_M_PER_HZ * np.exp(WALK_RATIO_SPREAD * generator.standard_normal())
    step_m = np.sqrt(speed_mps * ratio)
    cadence_hz = speed_mps / step_m
    return replace(
        random_walker(generator),
        speed_mps=speed_mps,
        step_factor=speed_mps / TYPICAL_SPEED_MPS / (cadence_hz / TYPICAL_CADENCE_HZ) ** 2,
        bounce_m=generator.uniform(*PASSED_ON) * step_m**2 / (16 * LEG_M),
    )


def resampled(walk: ReckonedWalk, rate_hz: float) -> ReckonedWalk:
    """The same walk by sensors of another rate."""
    t_s = np.arange(walk.imu.t_s[0], walk.imu.t_s[-1], 1 / rate_hz)
    accel, gyro = (
        np.column_stack([np.interp(t_s, walk.imu.t_s, column) for column in rows.T])
        for rows in (walk.imu.accel_mps2, walk.imu.gyro_radps)
    )
    return replace(walk, imu=Imu(t_s, accel, gyro))


def tilted(walk: ReckonedWalk, pitch_deg: float, roll_deg: float) -> ReckonedWalk:
    """The same walk with the phone's top tilted up, and the phone rolled about its long axis."""
    turn = Rotation.from_euler("XY", [pitch_deg, roll_deg], degrees=True).inv()
    imu, field = walk.imu, walk.magnetometer
    turned = Imu(imu.t_s, *(_applied(turn, rows) for rows in (imu.accel_mps2, imu.gyro_radps)))
    if field is not None:
        field = Magnetometer(field.t_s, _applied(turn, field.field_ut))
    return replace(walk, imu=turned, magnetometer=field)


def _applied(turn: Rotation, vectors: F64) -> F64:
    """SciPy takes no read-only arrays."""
    return np.asarray(turn.apply(vectors.copy()))


CHANGES: Mapping[str, Callable[[ReckonedWalk], ReckonedWalk]] = {
    "60 Hz": partial(resampled, rate_hz=60.0),
    "100 Hz": partial(resampled, rate_hz=100.0),
    "pitched by 30 degrees": partial(tilted, pitch_deg=30.0, roll_deg=0.0),
    "pitched by 60 degrees": partial(tilted, pitch_deg=60.0, roll_deg=0.0),
    "pitched and rolled by 30 degrees": partial(tilted, pitch_deg=30.0, roll_deg=30.0),
}

STUDY = Study(
    "How far does dead reckoning lead astray, and why?",
    measure_dead_reckoning, minutes=5, data=("mall_walks",),
    fast={"walks": 4, "seeds": 1, "worlds": ("studio",)},
)  # fmt: skip
