"""Floor changes by the barometer: level segmentation of a pressure curve, and by what each went.

Pressure becomes height by the hypsometric equation. Runs of vertical speed are candidates; weather
is too slow to be one, a door too quick, a gust goes back. What remains is as high as a storey, and
leads from floor to floor: stairs have a footstep for each step, lifts are faster than escalators.
Heights are counted from floor to floor, so that no drift of the weather adds up, and a floor that
is visited again is the one whose height it is at. Without a barometer floors are those that the
walker names.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import ndimage, signal

from elfslam.base.arrays import F64, I64
from elfslam.base.building import BuildingFloor, FloorsVisited
from elfslam.base.geometry import between, chain
from elfslam.base.parameters import parameter
from elfslam.base.values import Barometer, Checkpoints, LevelPassage, Levels, Odometry

SCALE_HEIGHT_M = 8576.0
"""Of air at 20 degrees: RT / gM."""
GRID_S = 0.25
MEDIAN_S = 1.0
"""Over so long a median takes out what a phone's case, pressed, does."""
EDGE = 0.1
"""A passage is timed from where this share of its height is made to where it remains."""
MOST_AT_ONCE = 0.8
"""Share of a change: not even a lift makes so much of a storey while a door opens."""
ESCALATOR_SLOPE_RAD, ESCALATOR_FLAT_M = np.deg2rad(30.0), 2.5
"""At both ends together its steps are level: three or so at each."""


@dataclass(frozen=True)
class LevelParameters:
    """What counts as a floor change, and how far one gets on it."""

    least_speed_mps: float = parameter(
        0.08, "m/s", "slower changes of height are the weather's", 0.01, 1.0
    )
    speed_window_s: float = parameter(4.0, "s", "span over which speed is taken", 1.0, 30.0)
    door_s: float = parameter(1.5, "s", "quicker changes of pressure are a door's", 0.0, 10.0)
    landing_s: float = parameter(12.0, "s", "flights this near each other are one", 0.0, 60.0)
    rest_s: float = parameter(60.0, "s", "half flights this near each other are one", 0.0, 600.0)
    least_flight_m: float = parameter(0.6, "m", "lower changes are no flight", 0.1, 10.0)
    least_storey_m: float = parameter(2.0, "m", "lower changes lead to no floor", 0.5, 20.0)
    same_floor_m: float = parameter(1.5, "m", "heights nearer than this are one floor", 0.1, 20.0)
    storey_m: float = parameter(
        3.8, "m", "typical storey, by which those that were not visited are counted", 2.4, 20.0
    )
    stay_s: float = parameter(
        40.0, "s", "span before and after a change over which heights are averaged", 1.0, 600.0
    )
    least_stay_s: float = parameter(
        5.0, "s", "who goes back sooner has been on no other floor", 0.0, 600.0
    )
    least_cadence_hz: float = parameter(0.8, "Hz", "with fewer footsteps somebody stands", 0.1, 3.0)
    most_rise_m: float = parameter(
        0.25, "m", "no stairs rise further a footstep: an escalator is walked", 0.1, 1.0
    )
    lift_speed_mps: float = parameter(
        0.38, "m/s", "who stands and is this fast is in a lift", 0.1, 3.0
    )
    vote_s: float = parameter(
        20.0, "s", "without a barometer the sound of so long votes on the floor", 0.1, 3600.0
    )
    least_lead: float = parameter(
        0.02, "", "similarity by which a floor must lead the next likely", 0.0, 2.0
    )
    tread_m: float = parameter(0.29, "m", "how far a footstep on stairs gets", 0.1, 1.0)
    tread_sigma_m: float = parameter(0.15, "m", "how far that is off, landings too", 0.01, 5.0)
    ride_sigma_m: float = parameter(0.7, "m", "what lifts and escalators add to that", 0.01, 10.0)


@dataclass(frozen=True)
class _Rise:
    """A change of height (m, up is positive) between two times (s)."""

    begin_s: float
    end_s: float
    height_m: float


def find_levels(
    barometer: Barometer, footsteps_t_s: F64, parameters: LevelParameters
) -> FloorsVisited:
    """Floors and passages of a walk with footsteps at the times (n); the first floor is level 0.

    One floor alone where nothing is as high as a storey, or the barometer ran less than the
    window of speed.
    """
    t_s, height_m = _heights(barometer)
    if len(t_s) * GRID_S <= parameters.speed_window_s:
        return _visited(float(barometer.t_s[0]), [], (), parameters)
    flights = _flights(t_s, height_m, parameters)
    rises = _without_returns(_lasting(flights, t_s, height_m, parameters), parameters)
    kinds = [_kind(each, footsteps_t_s, parameters) for each in rises]
    return _visited(float(t_s[0]), rises, kinds, parameters)


def _heights(barometer: Barometer) -> tuple[F64, F64]:
    """Height (n), m, over the first on a regular grid (n), s."""
    t_s, pressure = barometer.t_s, np.log(barometer.pressure_hpa)
    grid_s = np.arange(t_s[0], t_s[-1] + GRID_S / 2, GRID_S)
    edges = np.append(grid_s - GRID_S / 2, grid_s[-1] + GRID_S / 2)
    counts, sums = (np.histogram(t_s, edges, weights=each)[0] for each in (None, pressure))
    some = counts > 0
    mean = np.interp(grid_s, grid_s[some], sums[some] / counts[some])
    smooth = ndimage.median_filter(mean, round(MEDIAN_S / GRID_S) | 1, mode="nearest")
    return grid_s, SCALE_HEIGHT_M * (smooth[0] - smooth)


def _flights(t_s: F64, height_m: F64, parameters: LevelParameters) -> list[_Rise]:
    """Runs of vertical speed, each as high as a flight and slower than a door."""
    window = round(parameters.speed_window_s / GRID_S) | 1
    speed = signal.savgol_filter(height_m, window, 1, deriv=1, delta=GRID_S, mode="nearest")
    way = np.sign(speed) * (np.abs(speed) >= parameters.least_speed_mps)
    ends = np.flatnonzero(np.diff(way, prepend=0.0, append=0.0))
    runs = [(a, b) for a, b in pairwise(ends.tolist()) if way[a]]
    flights = []
    for first, after in runs:
        last = min(after, len(t_s) - 1)
        change_m = height_m[last] - height_m[first]
        if abs(change_m) < parameters.least_flight_m:
            continue
        share = (height_m[first : last + 1] - height_m[first]) / change_m
        if not _is_jump(share, parameters):
            flights.append(_Rise(float(t_s[first]), float(t_s[last]), float(change_m)))
    return flights


def _is_jump(share: F64, parameters: LevelParameters) -> bool:
    """Whether most of a change, of which `share` (n) was made by then, was made at once."""
    reach = min(round(parameters.door_s / GRID_S), len(share) - 1)
    return bool((share[reach:] - share[: len(share) - reach]).max() >= MOST_AT_ONCE)


def _merged(flights: Iterable[_Rise], parameters: LevelParameters) -> list[_Rise]:
    """Flights that follow each other the same way, with a landing between them, as one."""
    merged: list[_Rise] = []
    for each in flights:
        last = merged[-1] if merged else None
        if last is not None and _continues(last, each, parameters):
            merged[-1] = _Rise(last.begin_s, each.end_s, last.height_m + each.height_m)
        else:
            merged.append(each)
    return merged


def _lasting(
    flights: Sequence[_Rise], t_s: F64, height_m: F64, parameters: LevelParameters
) -> list[_Rise]:
    """Rises after which one stays a storey higher or lower than before: bottom-up segmentation.

    The one that changes least is no rise, and time and again, until each is as high as a storey.
    """
    sums = np.concatenate([[0.0], np.cumsum(height_m)])
    rises = _merged(flights, parameters)
    while rises:
        ends = np.searchsorted(t_s, [(each.begin_s, each.end_s) for each in rises])
        before_m, after_m = _plateaus(ends, sums, round(parameters.stay_s / GRID_S))
        changes_m = np.abs(after_m - before_m)
        weakest = int(np.argmin(changes_m))
        if changes_m[weakest] >= parameters.least_storey_m:
            plateaus_m = np.column_stack([before_m, after_m])
            return [_timed(t_s, height_m, *each) for each in zip(ends, plateaus_m, strict=True)]
        rises = _merged(rises[:weakest] + rises[weakest + 1 :], parameters)
    return []


def _plateaus(ends: I64, sums: F64, stay: int) -> tuple[F64, F64]:
    """Mean heights (k) over `stay` rows before each rise (k, 2: first and last row), and after.

    `sums` (n+1) are those of the heights; the stays end where another rise begins.
    """
    first, last = ends.T
    left = np.minimum(np.maximum(first - stay, np.append(0, last[:-1])), first)
    right = np.maximum(np.minimum(last + stay, np.append(first[1:], len(sums) - 2)), last)
    before, after = (
        (sums[b + 1] - sums[a]) / (b + 1 - a) for a, b in ((left, first), (last, right))
    )
    return before, after


def _timed(t_s: F64, height_m: F64, ends: I64, plateaus_m: F64) -> _Rise:
    """The rise between two rows and two heights: no gust before it counts, nor one after it."""
    first, last = ends
    rows = slice(first, last + 1)
    change_m = plateaus_m[1] - plateaus_m[0]
    share = (height_m[rows] - plateaus_m[0]) / change_m
    upper, lower = share >= 0.5, share < 0.5
    half, back = np.argmax(upper), len(share) - np.argmax(lower[::-1])
    begin = np.flatnonzero(share[: half + 1] <= EDGE)
    end = np.flatnonzero(share[back:] >= 1 - EDGE)
    left_s = float(t_s[first + (begin[-1] if len(begin) else 0)])
    reached_s = float(t_s[first + back + end[0] if len(end) else last])
    beyond_s = (reached_s - left_s) * EDGE / (1 - 2 * EDGE)
    return _Rise(
        max(left_s - beyond_s, float(t_s[first])),
        min(reached_s + beyond_s, float(t_s[last])),
        float(change_m),
    )


def _continues(last: _Rise, following: _Rise, parameters: LevelParameters) -> bool:
    """Whether a flight goes on after a landing, on which somebody may rest half way up."""
    halves = max(abs(last.height_m), abs(following.height_m)) < parameters.least_storey_m
    pause_s = following.begin_s - last.end_s
    longest_s = parameters.rest_s if halves else parameters.landing_s
    return last.height_m * following.height_m > 0 and pause_s <= longest_s


_Row = tuple[float, float, LevelPassage | None]
"""From when on, at which level, by what."""


def _without_returns(rises: Sequence[_Rise], parameters: LevelParameters) -> list[_Rise]:
    """The rises without those that were undone at once: gusts, and doors that close again."""
    kept: list[_Rise] = []
    for each in rises:
        back = kept and abs(kept[-1].height_m + each.height_m) < parameters.same_floor_m
        if back and each.begin_s - kept[-1].end_s < parameters.least_stay_s:
            kept.pop()
        else:
            kept.append(each)
    return kept


def _kind(rise: _Rise, footsteps_t_s: F64, parameters: LevelParameters) -> LevelPassage:
    """By what a rise was made: by how many footsteps, and how fast."""
    steps = int(((footsteps_t_s >= rise.begin_s) & (footsteps_t_s <= rise.end_s)).sum())
    if abs(rise.height_m) <= parameters.most_rise_m * steps:
        return LevelPassage.STAIRS
    lasting_s = rise.end_s - rise.begin_s
    walks = steps >= parameters.least_cadence_hz * lasting_s
    fast = abs(rise.height_m) >= parameters.lift_speed_mps * lasting_s
    return LevelPassage.LIFT if fast and not walks else LevelPassage.ESCALATOR


def _visited(
    begin_s: float,
    rises: Sequence[_Rise],
    kinds: Sequence[LevelPassage],
    parameters: LevelParameters,
) -> FloorsVisited:
    """The floors that rises lead to, numbered from the first, and when each was reached."""
    floor, heights_m = _floors(rises, parameters)
    order = np.argsort(heights_m)
    level = np.empty(len(order), dtype=np.int64)
    level[order] = _ordinals(heights_m[order], parameters)
    level -= level[0]
    rows: list[_Row] = [(begin_s, float(level[0]), None)]
    for rise, kind, reached in zip(rises, kinds, floor[1:], strict=True):
        left_s = max(rise.begin_s, rows[-1][0] + GRID_S)
        rows += [(left_s, np.nan, kind), (max(rise.end_s, left_s + GRID_S), level[reached], None)]
    t_s, levels, passages = zip(*rows, strict=True)
    floors = tuple(
        BuildingFloor(int(level[k]), round(float(heights_m[k] - heights_m[0]), 2)) for k in order
    )
    return FloorsVisited(Levels(np.array(t_s), np.array(levels), passages), floors)


def _floors(rises: Sequence[_Rise], parameters: LevelParameters) -> tuple[list[int], F64]:
    """Which floor one is on at first and after each rise, and the mean height (f) of each, m."""
    seen_m: list[list[float]] = [[0.0]]
    floor = [0]
    for rise in rises:
        means_m = np.array([np.mean(each) for each in seen_m])
        height_m = float(means_m[floor[-1]] + rise.height_m)
        nearest = int(np.argmin(np.abs(means_m - height_m)))
        if abs(means_m[nearest] - height_m) >= parameters.same_floor_m:
            nearest = len(seen_m)
            seen_m.append([])
        seen_m[nearest].append(height_m)
        floor.append(nearest)
    return floor, np.array([np.mean(each) for each in seen_m])


LOWEST_STOREY_M, STOREY_STEP_M = 2.4, 0.05
GAP_SIGMA_M, STOREY_SPREAD, SKIPPED = 0.8, 0.3, 0.5
"""How exactly gaps between floors are measured, the spread of storeys about the typical, of their
logarithm, and what each floor counts that nobody visited."""


def _ordinals(heights_m: F64, parameters: LevelParameters) -> F64:
    """How many storeys each floor (f), from below, lies over the lowest: some were not visited."""
    gaps_m = np.diff(heights_m)
    storeys_m = np.arange(LOWEST_STOREY_M, 2 * parameters.storey_m, STOREY_STEP_M)
    counts = np.maximum(1, np.rint(gaps_m / storeys_m[:, None]))
    off = (gaps_m - counts * storeys_m[:, None]) / GAP_SIGMA_M
    unusual = np.log(storeys_m / parameters.storey_m) / STOREY_SPREAD
    passed = SKIPPED * (counts - 1).sum(axis=1)
    likeliest = int(np.argmin(np.square(off).sum(axis=1) + np.square(unusual) + passed))
    return np.concatenate([[0], np.cumsum(counts[likeliest])])


FLOOR_NAME = re.compile(r"(?:level|floor|ebene|etage|stock) *([-+]?\d{1,2})", re.IGNORECASE)
"""A tap with such a name says on which floor the walker is from then on."""
PASSAGE_NAMES = {
    **dict.fromkeys(("stairs", "treppe"), LevelPassage.STAIRS),
    **dict.fromkeys(("lift", "elevator", "aufzug"), LevelPassage.LIFT),
    **dict.fromkeys(("escalator", "rolltreppe"), LevelPassage.ESCALATOR),
}
"""And with such a name that they are between floors, where taps name floors at all."""


def levels_by_taps(
    checkpoints: Checkpoints | None, begin_s: float, parameters: LevelParameters
) -> FloorsVisited | None:
    """Floors as a walker named them, with typical heights; None where they named none.

    Between a tap on stairs or a lift and the next on a floor the level is unknown.
    """
    taps = [] if checkpoints is None else _level_taps(checkpoints)
    named = [each for _, each in taps if isinstance(each, int)]
    if not named:
        return None
    first = taps[0][1] if isinstance(taps[0][1], int) else 0
    rows: list[_Row] = [(begin_s, float(first), None)]
    for when_s, what in taps:
        row = (when_s, float(what), None) if isinstance(what, int) else (when_s, np.nan, what)
        if when_s > rows[-1][0] and row[1:] != rows[-1][1:]:
            rows.append(row)
    t_s, levels, passages = zip(*rows, strict=True)
    visited = sorted({first, *named})
    floors = tuple(BuildingFloor(each, parameters.storey_m * each) for each in visited)
    return FloorsVisited(Levels(np.array(t_s), np.array(levels), passages), floors)


def numbered_by_taps(found: FloorsVisited, checkpoints: Checkpoints | None) -> FloorsVisited:
    """The floors that a barometer found, numbered as the first tap that names one says."""
    taps = [] if checkpoints is None else _level_taps(checkpoints)
    levels = [(t_s, each) for t_s, each in taps if isinstance(each, int)]
    known = [(each, found.levels.at(np.array(t_s))) for t_s, each in levels]
    shift = next((each - int(level) for each, level in known if np.isfinite(level)), 0)
    levels_there = replace(found.levels, level=found.levels.level + shift)
    floors = tuple(replace(each, level=each.level + shift) for each in found.floors)
    return FloorsVisited(levels_there, floors)


def without_level_taps(checkpoints: Checkpoints | None) -> Checkpoints | None:
    """The taps that name places, where others name floors: "level 1" is no place."""
    if checkpoints is None or not any(map(FLOOR_NAME.fullmatch, checkpoints.names)):
        return checkpoints
    kept = np.array([_floor_said(each) is None for each in checkpoints.names])
    names = tuple(name for name, keep in zip(checkpoints.names, kept, strict=True) if keep)
    return replace(checkpoints.chosen(kept), names=names) if names else None


def _level_taps(checkpoints: Checkpoints) -> list[tuple[float, int | LevelPassage]]:
    said = map(_floor_said, checkpoints.names)
    return [
        (t_s, each)
        for t_s, each in zip(checkpoints.t_s.tolist(), said, strict=True)
        if each is not None
    ]


def _floor_said(name: str) -> int | LevelPassage | None:
    found = FLOOR_NAME.fullmatch(name.strip())
    return int(found[1]) if found else PASSAGE_NAMES.get(name.strip().casefold())


def reckoned_on_passages(
    nodes: Odometry, visited: FloorsVisited, parameters: LevelParameters
) -> Odometry:
    """Dead reckoning with moves as long as stairs, lifts and escalators let them be.

    A footstep on stairs gets a tread ahead, one in a lift nowhere, and an escalator carries
    whoever stands on it as far as its slope says. The heading stays that of the gyroscope.
    """
    moves = between(nodes.world_from_body[:-1], nodes.world_from_body[1:])
    sigma = nodes.step_sigma.copy()
    lengths_m = np.linalg.norm(moves[:, :2], axis=1)
    wanted_m = lengths_m.copy()
    heights_m = {float(each.level): each.height_m for each in visited.floors}
    for begin_s, end_s, kind, ends in passages_of(visited.levels):
        lasting_s = np.minimum(nodes.t_s[1:], end_s) - np.maximum(nodes.t_s[:-1], begin_s)
        inside = lasting_s > 0
        if kind is LevelPassage.LIFT:
            wanted_m[inside], sigma[inside, :2] = 0.0, parameters.ride_sigma_m
            continue
        wanted_m[inside] = np.minimum(lengths_m[inside], parameters.tread_m)
        sigma[inside, :2] = parameters.tread_sigma_m
        if kind is LevelPassage.ESCALATOR and set(ends) <= heights_m.keys():
            rise_m = abs(heights_m[ends[1]] - heights_m[ends[0]])
            share = lasting_s[inside] / lasting_s[inside].sum()
            ridden_m = rise_m / np.tan(ESCALATOR_SLOPE_RAD) + ESCALATOR_FLAT_M
            wanted_m[inside] += share * ridden_m
            sigma[inside, :2] += np.sqrt(share)[:, None] * parameters.ride_sigma_m
    ahead = np.divide(
        moves[:, :2],
        lengths_m[:, None],
        where=lengths_m[:, None] > 0,
        out=np.tile([1.0, 0.0], (len(moves), 1)),
    )
    moved = np.column_stack([wanted_m[:, None] * ahead, moves[:, 2]])
    poses = chain(nodes.world_from_body[0], moved)
    return replace(nodes, world_from_body=poses, step_sigma=sigma)


def passages_of(
    levels: Levels,
) -> Iterator[tuple[float, float, LevelPassage | None, tuple[float, float]]]:
    """When each passage began and ended, its kind, and the levels before it and after it."""
    for k in range(1, len(levels.t_s) - 1):
        if np.isnan(levels.level[k]):
            ends = float(levels.level[k - 1]), float(levels.level[k + 1])
            yield float(levels.t_s[k]), float(levels.t_s[k + 1]), levels.passages[k], ends
