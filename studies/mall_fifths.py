"""Real floors: four fifths of the walks make the map, the others are located in it.

Mapping walks begin at a known place, query walks anywhere. The labelled baseline knows where every
mapped scan was made.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Fixes, Trajectory, Truth, WifiScans
from elfslam.baselines.floor_places import (
    FloorPlaces,
    at_each_place,
    floor_places,
    known_by,
    whole_walk,
)
from elfslam.baselines.floor_walks import FloorParameters, floor_map, floor_turn, solved, turned
from elfslam.baselines.wifi import (
    Fingerprints,
    WifiFingerprintParameters,
    place_scores,
    powers,
    wifi_places,
)
from studies.mall_floor import (
    ARCHIVE,
    FLOORS,
    SurveyedWalk,
    archive_of,
    error_records,
    surveyed_walks,
    use_of,
)
from studies.results import Record
from studies.study import Study, StudyContext, finished

SPLITS = 5
MAPPED_BY = (Modality.WIFI, Modality.MAGNETIC)
SOERENSEN, EUCLIDEAN = "Wi-Fi, labelled, Soerensen", "Wi-Fi, labelled, Euclidean"
ONE_PLACE, LIVE = "Wi-Fi, one place", "Wi-Fi, live"
TRAJECTORY, WITH_FIELD = "Wi-Fi, whole walk", "Wi-Fi and magnetic, whole walk"
METHODS = (SOERENSEN, EUCLIDEAN, ONE_PLACE, LIVE, TRAJECTORY, WITH_FIELD)
NEIGHBOURS = 3
UNSEEN_DBM = -104.0
POWED = WifiFingerprintParameters(floor_dbm=UNSEEN_DBM, power=float(np.e))
"""Strengths above the floor to the power of e (Torres-Sospedra et al. 2015). By these the share of
power in common orders places as Soerensen's distance does, which is a function of it."""
LINEAR = WifiFingerprintParameters(floor_dbm=UNSEEN_DBM, power=1.0)
Scan = tuple[WifiScans, Truth]
Alike = Callable[[Fingerprints], F64]
ERROR = "error (m)"


@dataclass(frozen=True)
class Split:
    """The walks of a floor of which every fifth, from `which` on, is held out."""

    floor: str
    which: int


def measure_mall_fifths(
    context: StudyContext, *, floors: Sequence[str] = tuple(FLOORS), most_walks: int | None = None
) -> list[Record]:
    """Errors at the waypoints of walks that are held out in turn, by floor and method.

    Raises InputError where there are no walks.
    """
    tasks = [Split(floor, which) for floor in floors for which in range(SPLITS)]
    measure = partial(_measured, data=context.data, most_walks=most_walks)
    errors: dict[tuple[str, str], dict[str, list[float]]] = {}
    for each in (record for found in finished(measure, tasks, context) for record in found):
        of_walk = errors.setdefault((each.world, each.method), {})
        of_walk.setdefault(each.condition, []).append(each.value)
    return [
        record
        for (floor, method), walks in errors.items()
        for record in fifths_records(floor, method, [np.array(each) for each in walks.values()])
    ]


def fifths_records(floor: str, method: str, errors: Sequence[F64]) -> Iterator[Record]:
    """Errors of one method over all walks at their waypoints (k), and how many have an answer."""
    answered = [each[np.isfinite(each)] for each in errors]
    yield from error_records(floor, method, answered)
    waypoints = sum(map(len, errors))
    yield from Record(method, world=floor, condition=use_of(floor)).each({
        "answered": sum(map(len, answered)) / waypoints, "walks": len(errors),
        "waypoints": waypoints,
    })  # fmt: skip


def located_walks(archive: Path, most: int | None) -> list[SurveyedWalk]:
    """The walks of a floor with two waypoints and Wi-Fi, as `surveyed_walks` has them."""
    walks = surveyed_walks(archive, most)
    kept = [walk for walk in walks if walk.recording.wifi is not None]
    if len(kept) < SPLITS:
        raise InputError(f"{archive}: got {len(kept)} walks with Wi-Fi, wanted {SPLITS} or more")
    return kept


def split_walks(
    walks: Sequence[SurveyedWalk], which: int
) -> tuple[list[SurveyedWalk], dict[int, SurveyedWalk]]:
    """The walks to be mapped, and by their number those that are held out.

    All are turned by the angle of the floor that the mapped walks tell.
    """
    mapped = [walk for number, walk in enumerate(walks) if number % SPLITS != which]
    turn_rad = floor_turn(mapped, FloorParameters()).turn_rad
    held = {number: turned(walks[number], turn_rad) for number in range(which, len(walks), SPLITS)}
    return [turned(walk, turn_rad) for walk in mapped], held


def positions(
    mapped: Sequence[SurveyedWalk], places: FloorPlaces, held: Sequence[SurveyedWalk]
) -> dict[str, list[F64]]:
    """Where each method has each held-out walk at its waypoints (k, 2), NaN for no answer."""
    known = [(_scans(walk), walk.truth) for walk in mapped]
    asked = [(_scans(walk), walk.truth) for walk in held]
    by_wifi = replace(places, levels=None)
    return {
        SOERENSEN: list(labelled_neighbours(asked, known, "Soerensen")),
        EUCLIDEAN: list(labelled_neighbours(asked, known, "Euclidean")),
        ONE_PLACE: [_between_fixes(at_each_place(walk, places), walk) for walk in held],
        LIVE: [_live(walk, by_wifi) for walk in held],
        TRAJECTORY: [_at_waypoints(walk, whole_walk(walk, by_wifi)) for walk in held],
        WITH_FIELD: [_at_waypoints(walk, whole_walk(walk, places)) for walk in held],
    }


def _between_fixes(fixes: Fixes, walk: SurveyedWalk) -> F64:
    """Positions (k, 2) at the waypoints, between the fixes before and after."""
    good, at_s = np.isfinite(fixes.xy_m[:, 0]), walk.truth.t_s
    if not good.any():
        return np.full((len(at_s), 2), np.nan)
    t_s, xy_m = fixes.t_s[good], fixes.xy_m[good]
    return np.column_stack([np.interp(at_s, t_s, column) for column in xy_m.T])


def _live(walk: SurveyedWalk, places: FloorPlaces) -> F64:
    """Positions (k, 2), each the last footstep of what was known by then."""
    counts = np.searchsorted(walk.nodes.t_s, walk.truth.t_s, side="right")
    known = [known_by(walk, places, int(count)) for count in counts]
    nowhere = np.full(2, np.nan)
    return np.array([nowhere if each is None else each.world_from_body[-1, :2] for each in known])


def _at_waypoints(walk: SurveyedWalk, found: Trajectory | None) -> F64:
    if found is None:
        return np.full((len(walk.truth.t_s), 2), np.nan)
    return interpolate_poses(found.t_s, found.world_from_body, walk.truth.t_s)[:, :2]


@cache
def _walks_on(floor: str, data: Path | None, most: int | None) -> list[SurveyedWalk]:
    return located_walks(archive_of(data, floor), most)


def _measured(split: Split, data: Path | None, most_walks: int | None) -> list[Record]:
    """Errors at waypoints of held-out walks, NaN without an answer; the condition is the walk."""
    mapped, held = split_walks(_walks_on(split.floor, data, most_walks), split.which)
    parameters = FloorParameters()
    trajectories, _ = solved(mapped, MAPPED_BY, parameters)
    known = floor_map(mapped, trajectories, MAPPED_BY, parameters)
    places = floor_places(known, MAPPED_BY, parameters)
    found = positions(mapped, places, list(held.values()))
    return [
        Record(method, ERROR, float(error_m), world=split.floor, condition=str(number))
        for method, walks in found.items()
        for (number, walk), at in zip(held.items(), walks, strict=True)
        for error_m in np.linalg.norm(at - walk.truth.world_from_body[:, :2], axis=1)
    ]


def _scans(walk: SurveyedWalk) -> WifiScans:
    assert walk.recording.wifi is not None
    return walk.recording.wifi


def labelled_neighbours(
    walks: Sequence[Scan], known: Sequence[Scan], distance: str
) -> Iterator[F64]:
    """Positions (k, 2) at the waypoints of each walk: each from the scans before and after it.

    A scan is where the three most similar scans of the known walks truly were.
    """
    xy_m = np.vstack([_true_at(scans.t_s, truth) for scans, truth in known])
    alike = ALIKE[distance]([_each(scans) for scans, _ in known])
    for scans, truth in walks:
        best = np.argsort(-alike(_each(scans)), axis=1, kind="stable")[:, :NEIGHBOURS]
        at_m = xy_m[best].mean(axis=1)
        yield _between(scans.t_s, at_m, truth.t_s)


def _each(scans: WifiScans) -> Fingerprints:
    heard = np.where(np.isfinite(scans.rssi_dbm), scans.rssi_dbm, UNSEEN_DBM)
    return Fingerprints(scans.bssids, heard)


def _true_at(t_s: F64, truth: Truth) -> F64:
    return _between(truth.t_s, truth.world_from_body[:, :2], t_s)


def _between(t_s: F64, xy_m: F64, at_s: F64) -> F64:
    return np.column_stack([np.interp(at_s, t_s, xy_m[:, axis]) for axis in (0, 1)])


def _soerensen(known: Sequence[Fingerprints]) -> Alike:
    nowhere = [np.zeros((len(each.rssi_dbm), 2)) for each in known]
    places = wifi_places(known, nowhere, POWED)
    return lambda one: place_scores(one, places, POWED)


def _euclidean(known: Sequence[Fingerprints]) -> Alike:
    """Minus the squared distances, but for what is heard at the one place and never there."""
    places = wifi_places(known, [np.zeros((len(each.rssi_dbm), 2)) for each in known], LINEAR)
    square = (places.power**2).sum(axis=0)

    def alike(one: Fingerprints) -> F64:
        here = powers(one, places.bssids, LINEAR)
        return np.asarray(2 * here @ places.power - square)

    return alike


ALIKE: Mapping[str, Callable[[Sequence[Fingerprints]], Alike]] = {
    "Soerensen": _soerensen,
    "Euclidean": _euclidean,
}


STUDY = Study(
    "How far off are walks located on a real mall floor that other people's walks mapped?",
    measure_mall_fifths, minutes=10, data=tuple(map(ARCHIVE.format, FLOORS)), long=True,
    fast={"floors": ("F1",), "most_walks": 8},
)  # fmt: skip
