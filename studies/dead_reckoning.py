"""How far dead reckoning leads astray: on all walks of two mall floors, and on simulated ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.geometry import compose, interpolate_poses, path_length_m, wrap_angle
from elfslam.base.values import Odometry
from elfslam.line.motion import (
    HardIron,
    MotionParameters,
    calibrated_by_distance,
    compass_heading,
    dead_reckon,
)
from elfslam.scoring.alignment import Alignment, match, placement
from elfslam.scoring.bootstrap import interval
from elfslam.scoring.consistency import Displacements, displacement_errors
from elfslam.scoring.errors import end_error_share, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from studies.error_sources import end_errors
from studies.figures.curves import Curve, curves_figure
from studies.figures.walk_figures import DrawnWalk, walks_figure
from studies.finding import Finding, Given, Row
from studies.reckoned_walks import (
    WORLDS,
    ReckonedWalk,
    mall_floors,
    resampled,
    simulated_walks,
    tilted,
)

DISTANCES_M = (5.0, 20.0, 60.0)
WAYPOINT_SIGMA_M = 0.4
"""How far surveyors tap a waypoint from where they are, per axis: consecutive legs of a walk err
against each other by so much."""
SHOWN = 12
TRUE_LEG, UNTURNED, COMPASS, COMPASS_KNOWN, ROTATION = (
    "first leg of the truth",
    "compass, this walk alone, no angle of the floor (elfslam map)",
    "compass, this walk alone",
    "compass, phone known from the walks before",
    "rotation vector of the phone",
)
AS_HELD = "50 Hz, as held"
CHANGES: Mapping[str, Callable[[ReckonedWalk], ReckonedWalk]] = {
    "60 Hz": partial(resampled, rate_hz=60.0),
    "100 Hz": partial(resampled, rate_hz=100.0),
    "pitched by 30 degrees": partial(tilted, pitch_deg=30.0, roll_deg=0.0),
    "pitched by 60 degrees": partial(tilted, pitch_deg=60.0, roll_deg=0.0),
    "pitched and rolled by 30 degrees": partial(tilted, pitch_deg=30.0, roll_deg=30.0),
}


@dataclass(frozen=True)
class Scored:
    """What is known of one walk in one way."""

    end_share: float
    rmse_m: float
    scale: float


def measure_dead_reckoning(
    given: Given, *, walks: int | None = None, seeds: int = 6, worlds: Sequence[str] = WORLDS
) -> Finding:
    """End errors, step scale and normalised errors of dead reckoning; `data` has the mall walks.

    Without `data` only simulated walks are measured. `walks` takes the first of each floor
    alone, `seeds` so many walks of each simulated world of `worlds`.
    """
    floors = {} if given.data is None else dict(mall_floors(given.data, walks, given.announce))
    given.announce("simulated walks", 0.5)
    simulated = {
        f"{world}, {rate} Hz": walked for world, rate, walked in simulated_walks(worlds, seeds)
    }
    rows: list[Row] = []
    given.announce("mall walks", 0.6)
    rows += _real_rows(floors) if floors else []
    for name, some in simulated.items():
        rows += _simulated_rows(name, some)
    given.announce("uncertainty", 0.9)
    groups = {**floors, "simulated": [walk for some in simulated.values() for walk in some]}
    consistency = [
        row
        for name, some in groups.items()
        for row in _consistency_rows(name, some, WAYPOINT_SIGMA_M if name in floors else 0.0)
    ]
    sources = list(_source_rows(floors))
    page = _page(rows, sources, consistency, floors, simulated)
    return Finding([*_joined(rows, sources, consistency)], page)


def _real_rows(floors: Mapping[str, Sequence[ReckonedWalk]]) -> Iterator[Row]:
    """A row for each way to know the heading, and for each way to hold or sample the phone."""
    for heading in (UNTURNED, COMPASS, COMPASS_KNOWN, ROTATION, TRUE_LEG):
        yield from _floor_rows(AS_HELD, heading, floors, partial(_scored, heading=heading))
    for name, change in CHANGES.items():
        changed = {floor: [change(walk) for walk in walks] for floor, walks in floors.items()}
        score = partial(_scored, heading=COMPASS_KNOWN)
        yield from _floor_rows(name, COMPASS_KNOWN, changed, score)
    yield from _floor_rows(AS_HELD, f"{TRUE_LEG}, length known", floors, _calibrated)


def _floor_rows(
    sensors: str,
    heading: str,
    floors: Mapping[str, Sequence[ReckonedWalk]],
    score: Callable[[Sequence[ReckonedWalk]], list[Scored]],
) -> Iterator[Row]:
    """A row for every floor, and one for all walks together."""
    together: list[Scored] = []
    for floor, walks in floors.items():
        scored = score(walks)
        together += scored
        yield _row(f"mall {floor}", sensors, heading, scored)
    yield _row("mall, all", sensors, heading, together)


def _simulated_rows(name: str, walks: Sequence[ReckonedWalk]) -> list[Row]:
    return [
        _row(name, "as simulated", "true start", _scored(walks, TRUE_LEG)),
        _row(name, "as simulated", "true start, length known", _calibrated(walks)),
    ]


def _row(walks_of: str, sensors: str, heading: str, scored: Sequence[Scored]) -> Row:
    ends = [np.array([100 * one.end_share]) for one in scored]
    low, high = interval(ends, lambda values: float(np.median(values)), np.random.default_rng(0))
    return {
        "walks of": walks_of,
        "sensors": sensors,
        "heading from": heading,
        "walks": len(scored),
        "end error (%)": round(float(np.median(np.concatenate(ends))), 2),
        "from": round(low, 2),
        "to": round(high, 2),
        "aligned RMSE (m)": round(float(np.median([one.rmse_m for one in scored])), 2),
        "scale": round(float(np.median([one.scale for one in scored])), 3),
        "scale spread": round(float(np.std([one.scale for one in scored])), 3),
    }


def _scored(walks: Sequence[ReckonedWalk], heading: str) -> list[Scored]:
    """Every walk, with its start known and its heading from one of the sources.

    Where that is the phone, one angle per floor turns north into the plane of the truth: the
    median over the floor's walks of what turns each best onto its truth; or none does.
    """
    reckoned = [dead_reckon(walk.imu, MotionParameters()) for walk in walks]
    if heading == TRUE_LEG:
        ends = [
            end_error_share(o.t_s, o.world_from_body, walk.truth)
            for o, walk in zip(reckoned, walks, strict=True)
        ]
    else:
        starts = _starts_rad(walks, heading)
        turn_rad = 0.0 if heading == UNTURNED else _floor_turn_rad(reckoned, walks, starts)
        ends = list(_ends(reckoned, walks, starts + turn_rad))
    return [
        _summed(odometry, walk, end)
        for odometry, walk, end in zip(reckoned, walks, ends, strict=True)
    ]


def _summed(odometry: Odometry, walk: ReckonedWalk, end_share: float) -> Scored:
    errors = position_errors(odometry.t_s, odometry.world_from_body, walk.truth, Alignment.ALIGNED)
    matched = match(odometry.t_s, odometry.world_from_body, walk.truth)
    scale = placement(matched, Alignment.ALIGNED_WITH_SCALE).scale
    return Scored(end_share, float(np.sqrt(np.mean(errors**2))), scale)


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
        yield end_errors(*_headed(odometry, walk, heading_rad))["nothing"]


def _headed(odometry: Odometry, walk: ReckonedWalk, heading_rad: float) -> tuple[F64, F64]:
    """A walk (n, 2) with this heading at its first footstep, and where it truly was."""
    matched = match(odometry.t_s, odometry.world_from_body, walk.truth)
    moved = compose(np.array([0.0, 0.0, heading_rad]), matched.estimate)
    return moved[:, :2], matched.truth[:, :2]


def _source_rows(floors: Mapping[str, Sequence[ReckonedWalk]]) -> Iterator[Row]:
    """Median end errors by compass, with one thing after the other replaced by the truth."""
    for floor, walks in floors.items():
        reckoned = [dead_reckon(walk.imu, MotionParameters()) for walk in walks]
        starts = _starts_rad(walks, COMPASS_KNOWN)
        headings = starts + _floor_turn_rad(reckoned, walks, starts)
        found = [
            end_errors(*_headed(odometry, walk, heading_rad))
            for odometry, walk, heading_rad in zip(reckoned, walks, headings, strict=True)
        ]
        for name in found[0]:
            share = float(np.median([one[name] for one in found]))
            yield {
                "walks of": f"mall {floor}",
                "truth in place of": name,
                "walks": len(found),
                "end error (%)": round(100 * share, 2),
            }


def _calibrated(walks: Sequence[ReckonedWalk]) -> list[Scored]:
    """Every walk by a walker whose step length is known from the length of that same walk."""
    scored = []
    for walk in walks:
        odometry = dead_reckon(walk.imu, MotionParameters())
        matched = match(odometry.t_s, odometry.world_from_body, walk.truth)
        share = path_length_m(matched.truth[:, :2]) / path_length_m(matched.estimate[:, :2])
        moves_m = path_length_m(odometry.world_from_body[:, :2])
        own = calibrated_by_distance(walk.imu, share * moves_m, MotionParameters())
        taught = dead_reckon(walk.imu, own)
        end = end_error_share(taught.t_s, taught.world_from_body, walk.truth)
        scored.append(_summed(taught, walk, end))
    return scored


def _consistency_rows(name: str, walks: Sequence[ReckonedWalk], truth_sigma_m: float) -> list[Row]:
    """Normalised errors of displacements over several distances, all walks together."""
    rows: list[Row] = []
    reckoned = [dead_reckon(walk.imu, MotionParameters()) for walk in walks]
    for distance_m in DISTANCES_M:
        found = [
            displacement_errors(odometry, walk.truth, distance_m, truth_sigma_m)
            for odometry, walk in zip(reckoned, walks, strict=True)
        ]
        rows.append(_consistency_row(name, distance_m, found))
    return rows


def _consistency_row(name: str, distance_m: float, found: Sequence[Displacements]) -> Row:
    error, sigma = (
        np.vstack([getattr(one, key) for one in found]) for key in ("error_m", "sigma_m")
    )
    nees, within = np.concatenate([one.nees for one in found]), np.abs(error) / sigma
    figures = {
        "error along (m)": _rms(error[:, 0]),
        "said along (m)": _rms(sigma[:, 0]),
        "error across (m)": _rms(error[:, 1]),
        "said across (m)": _rms(sigma[:, 1]),
        "NEES (2)": _mean(nees),
        "1 sigma along (0.68)": _mean(within[:, 0] < 1),
        "1 sigma across (0.68)": _mean(within[:, 1] < 1),
        "2 sigma along (0.95)": _mean(within[:, 0] < 2),
        "2 sigma across (0.95)": _mean(within[:, 1] < 2),
    }
    return {"walks of": name, "over (m)": distance_m, "displacements": len(nees), **figures}


def _rms(values: F64) -> float | None:
    return round(float(np.sqrt(np.mean(values**2))), 2) if len(values) else None


def _mean(values: F64 | Bool) -> float | None:
    """None where there is nothing: a small room has no displacement over sixty metres."""
    return round(float(np.mean(values)), 2) if len(values) else None


def _joined(*tables: Sequence[Row]) -> Iterator[Row]:
    """The rows of several tables with the columns of all of them, None where one has none."""
    names = list(dict.fromkeys(name for rows in tables for row in rows for name in row))
    for rows in tables:
        for row in rows:
            yield {name: row.get(name) for name in names}


def _page(
    rows: Sequence[Row],
    sources: Sequence[Row],
    consistency: Sequence[Row],
    floors: Mapping[str, Sequence[ReckonedWalk]],
    worlds: Mapping[str, Sequence[ReckonedWalk]],
) -> Page:
    panels = [
        Panel(
            f"Floor {floor}: {min(SHOWN, len(some))} of {len(some)} walks",
            walks_figure(_drawn(some)),
            "Taken at even steps through the list, in metres. Heading by compass; lines join "
            "waypoints to where the walk was reckoned to be at that time.",
            wide=True,
        )
        for floor, some in floors.items()
    ]
    shares = {f"mall {name}": _scored(some, COMPASS_KNOWN) for name, some in floors.items()}
    shares["simulated"] = _scored([walk for some in worlds.values() for walk in some], TRUE_LEG)
    curves = {
        name: Curve(
            np.sort([100 * one.end_share for one in scored]), np.linspace(0, 100, len(scored))
        )
        for name, scored in shares.items()
    }
    figure = curves_figure(curves, "end error (% of the path)", "walks below (%)")
    panels.append(
        Panel("End errors", figure, "Mall by compass, simulated by true start.", wide=True)
    )
    panels.append(Panel("All ways", rows_table(rows), wide=True))
    panels.append(Panel("Where the error comes from", rows_table(sources), SOURCES, wide=True))
    panels.append(
        Panel("Is the uncertainty right?", rows_table(consistency), CONSISTENCY, wide=True)
    )
    return Page(
        "Dead reckoning", "Real walks in a mall and simulated walks, one set of parameters", panels
    )


SOURCES = "Median end error by compass, the phone known, with one thing replaced by the truth."
CONSISTENCY = (
    "Displacements from where the walk truly was, heading the way of the ten metres "
    "before; NEES is 2 in the mean where sigmas are right."
)


def _drawn(walks: Sequence[ReckonedWalk]) -> list[DrawnWalk]:
    """Some walks as their compass has them, each from its true start."""
    reckoned = [dead_reckon(walk.imu, MotionParameters()) for walk in walks]
    starts = _starts_rad(walks, COMPASS_KNOWN)
    headings = starts + _floor_turn_rad(reckoned, walks, starts)
    ends = list(_ends(reckoned, walks, headings))
    drawn = []
    for k in range(0, len(walks), max(1, len(walks) // SHOWN))[:SHOWN]:
        truth, odometry = walks[k].truth, reckoned[k]
        poses = compose(np.array([0.0, 0.0, headings[k]]), odometry.world_from_body)
        matched = match(odometry.t_s, poses, truth)
        shift = (
            matched.truth[0, :2] - interpolate_poses(odometry.t_s, poses, matched.t_s[:1])[0, :2]
        )
        title = f"{100 * ends[k]:.0f} % of {path_length_m(matched.truth[:, :2]):.0f} m"
        drawn.append(
            DrawnWalk(
                title, poses[:, :2] + shift, matched.truth[:, :2], matched.estimate[:, :2] + shift
            )
        )
    return drawn
