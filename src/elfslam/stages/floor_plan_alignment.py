"""Registration of a walk on a floor plan: placements that keep to accessible ground.

All headings and all shifts of a grid are tried; a shift of the whole walk is one correlation,
made by FFT. A placement is as likely as the walk's distance from accessible ground allows, so
that plans with room to spare, and plans that look the same turned, give several.
"""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import distance_transform_edt

from elfslam.base.arrays import F32, F64, I64, Value, array
from elfslam.base.errors import NoAnswerError
from elfslam.base.geometry import mean_pose, wrap_angle
from elfslam.base.grid import FloorGrid, resampled
from elfslam.base.parameters import parameter

OK, AMBIGUOUS, NOWHERE = "OK", "AMBIGUOUS", "NOWHERE"
SPREAD = np.arange(-2.0, 3.0)
SPREAD_WEIGHTS = np.exp(-(SPREAD**2) / 2) / np.exp(-(SPREAD**2) / 2).sum()
"""Sigmas of the scale that are tried, and how likely each is beforehand."""
NEGLIGIBLE = 12.0
"""What is less likely by this exponent is dropped."""
MOST_PER_TURN = 2000
"""Of one heading and scale; where there are more, each kept one stands for several."""
RECENTRINGS = 8
MOST_PLANS = 3
"""A walk that would cross the plan so often leaves it wherever it is placed."""


@dataclass(frozen=True)
class AnchoringParameters:
    """How a walk is placed on a plan."""

    cell_m: float = parameter(0.1, "m", "finest step of the search", 0.02, 2.0)
    widest: int = parameter(
        150, "", "squares across a plan; larger plans get larger squares", 20, 5000
    )
    error_m: float = parameter(
        0.15, "m", "error of a mapped walk and of the plan, one sigma", 0.01, 5.0
    )
    patch_m: float = parameter(
        0.5, "m", "side of a square within which a walk's errors are one", 0.1, 20.0
    )
    keep_off_m: float = parameter(
        0.4, "m", "distance that people keep from walls, to their middle", 0.0, 2.0
    )
    reach_m: float = parameter(
        0.6, "m", "further off accessible ground is no less likely", 0.1, 10.0
    )
    scale_sigma: float = parameter(
        0.02, "", "relative error of the walk's length, one sigma", 0.0, 0.2
    )
    near_m: float = parameter(
        1.5, "m", "placements of the walk's middle that count as one", 0.05, 20.0
    )
    near_rad: float = parameter(0.6, "rad", "headings of the walk that count as one", 0.01, 3.2)
    tag_sigma_m: float = parameter(
        1.0, "m", "how well a place is known that somebody names, per axis", 0.01, 100.0
    )
    certainty: float = parameter(
        0.95, "", "probability from which one placement is taken", 0.5, 1.0
    )
    most_off: float = parameter(
        0.1, "", "share of a walk that may lie off accessible ground", 0.0, 1.0
    )


@dataclass(frozen=True, eq=False)
class Placement(Value):
    """Where a map lies on a plan: first shrunk or stretched by `scale`, then moved.

    `covariance` is of the position (m) of the walk's middle and of the heading (rad). `shares`
    are the probabilities of this placement and of the others, likeliest first, where those lie is
    `others` (x, y, heading of the map's origin). `status` is OK, AMBIGUOUS where no placement is
    likely enough, NOWHERE where the walk leaves accessible ground under the best one.
    """

    plan_from_map: F64 = array(3)
    covariance: F64 = array(3, 3)
    shares: F64 = array("k")
    others: F64 = array("k-1", 3)
    scale: float
    off_share: float
    status: str


@dataclass(frozen=True, eq=False)
class Candidates(Value):
    """Placements of the walk's middle (x, y, heading), their scale and probability."""

    poses: F64 = array("n", 3)
    scale: F64 = array("n")
    probability: F64 = array("n")


@dataclass(frozen=True, eq=False)
class Tag(Value):
    """A place of the map that somebody knows on the plan: the entrance where a walk began, say."""

    on_map_m: F64 = array(2)
    on_plan_m: F64 = array(2)


def anchor(
    lines_m: Sequence[F64], plan: FloorGrid, parameters: AnchoringParameters, tag: Tag | None = None
) -> Placement:
    """The placement of a map's walks (lines, each n, 2) on the accessible ground of a plan.

    The covariance of a map is no part of it: that is of positions seen from the map's origin, and
    most of it is a common move that the placement takes away. Raises NoAnswerError where the
    walks are far larger than the plan.
    """
    plan_m = plan.cell_m * max(plan.free.shape)
    across_m = float(np.ptp(np.concatenate(lines_m), axis=0).max())
    if across_m > MOST_PLANS * plan_m:
        raise NoAnswerError(
            f"the walk is {across_m:.4g} m across and the plan {plan_m:.4g} m; is it that floor, "
            "and is the width right?"
        )
    cell_m = max(parameters.cell_m, plan_m / parameters.widest)
    points = np.concatenate([resampled(line, cell_m) for line in lines_m])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    walk, weights = points - middle, _weights(points, parameters.patch_m)
    ground = standing(plan, parameters.keep_off_m)
    gaps, corner_m = _gaps(ground, cell_m, parameters.reach_m)
    # A square of the search blurs by its own width.
    variance_m2 = parameters.error_m**2 + cell_m**2 / 12
    candidates = _candidates(walk, weights / (2 * variance_m2), gaps, corner_m, cell_m, parameters)
    if tag is not None:
        candidates = _tagged(
            candidates, tag.on_map_m - middle, tag.on_plan_m, parameters.tag_sigma_m
        )
    found = list(_modes(candidates, parameters))
    shares = np.array([share for share, _, _, _ in found])
    poses = np.array([_of_origin(pose, scale, middle) for _, pose, scale, _ in found])
    _, best, scale, covariance = found[0]
    off = _off_share(placed(walk, best, scale), weights, ground, 2 * parameters.error_m)
    status = (
        NOWHERE
        if off > parameters.most_off
        else OK
        if shares[0] >= parameters.certainty
        else AMBIGUOUS
    )
    return Placement(poses[0], covariance, shares, poses[1:], scale, off, status)


def placed(xy_m: F64, plan_from_map: F64, scale: float) -> F64:
    """Points (n, 2) of the map on the plan."""
    x, y, heading = plan_from_map
    cos, sin = np.cos(heading), np.sin(heading)
    return np.asarray(scale * xy_m @ np.array([[cos, sin], [-sin, cos]]) + [x, y])


def _weights(points: F64, patch_m: float) -> F64:
    """One for each square of ground that is walked, shared by the points in it."""
    squares = np.floor(points / patch_m).astype(np.int64)
    _, square, count = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(1.0 / count[np.asarray(square).reshape(-1)])


def standing(plan: FloorGrid, keep_off_m: float) -> FloorGrid:
    """The ground that lies further than this from walls and whatever else blocks the way."""
    free = np.pad(plan.free, 1)
    room_m = distance_transform_edt(free)[1:-1, 1:-1] * plan.cell_m
    return FloorGrid(room_m > keep_off_m, plan.corner_m, plan.cell_m)


def _gaps(ground: FloorGrid, cell_m: float, reach_m: float) -> tuple[F32, F64]:
    """How much nearer than out of reach standing ground is: reach squared less gap squared.

    In squares of the search, and where the middle of the first one lies. Beyond all is 0.
    """
    margin = int(np.ceil(reach_m / ground.cell_m)) + 1
    free = np.pad(ground.free, margin)
    if not free.any():
        return np.zeros((1, 1), dtype=np.float32), ground.corner_m
    gap_m = distance_transform_edt(~free) * ground.cell_m
    worth = np.maximum(reach_m**2 - gap_m**2, 0)
    corner_m = ground.corner_m - margin * ground.cell_m
    rows, columns = (np.array(worth.shape) * ground.cell_m / cell_m).astype(int) + 1
    row, column = (
        np.minimum(((np.arange(n) + 0.5) * cell_m / ground.cell_m).astype(int), most - 1)
        for n, most in zip((rows, columns), worth.shape, strict=True)
    )
    return worth[np.ix_(row, column)].astype(np.float32), corner_m + cell_m / 2


def _candidates(
    walk: F64,
    weights: F64,
    gaps: F32,
    corner_m: F64,
    cell_m: float,
    parameters: AnchoringParameters,
) -> Candidates:
    """All placements that are not negligible, with their probability."""
    radius = int(np.ceil(np.linalg.norm(walk, axis=1).max() * 1.2 / cell_m)) + 2
    shape = [next_fast_len(size + 2 * radius, real=True) for size in gaps.shape]
    spectrum = rfft2(gaps, shape)
    most = float(weights.sum()) * parameters.reach_m**2
    kept: list[F64] = []
    best = -np.inf
    for heading, scale, prior in _turns(walk, cell_m, parameters):
        turned = placed(walk, np.array([0, 0, heading]), scale)
        stamp = _stamp(turned / cell_m + radius, weights, 2 * radius + 1)
        # Correlation: the walk's middle at (row, column) is entry (row - radius, column - radius).
        worth = irfft2(spectrum * np.conj(rfft2(stamp, shape)), shape)
        worth = np.roll(worth, (radius, radius), axis=(0, 1))
        log = worth[: gaps.shape[0], : gaps.shape[1]] - most + np.log(prior)
        best = max(best, float(log.max()))
        row, column = np.nonzero(log > best - NEGLIGIBLE)
        apart = len(row) // MOST_PER_TURN + 1
        row, column = row[::apart], column[::apart]
        xy_m = corner_m + cell_m * np.column_stack([column, row])
        told = np.full((len(row), 2), (heading, scale))
        kept.append(np.column_stack([xy_m, told, log[row, column] + np.log(apart)]))
    table = np.concatenate(kept)
    table = table[table[:, 4] > best - NEGLIGIBLE]
    likely = np.exp(table[:, 4] - best)
    return Candidates(table[:, :3], table[:, 3], likely / likely.sum())


def _turns(
    walk: F64, cell_m: float, parameters: AnchoringParameters
) -> Iterator[tuple[float, float, float]]:
    """Headings a square apart at the walk's typical distance from its middle; scales; priors."""
    radius_m = max(float(np.sqrt(np.mean(np.sum(walk**2, axis=1)))), cell_m)
    count = int(np.ceil(2 * np.pi * radius_m / cell_m))
    exact = parameters.scale_sigma == 0
    spread = [(0.0, 1.0)] if exact else list(zip(SPREAD, SPREAD_WEIGHTS, strict=True))
    for k in range(count):
        for sigmas, prior in spread:
            yield 2 * np.pi * k / count, 1 + float(sigmas) * parameters.scale_sigma, float(prior)


def _stamp(places: F64, weights: F64, size: int) -> F32:
    """Weights of points (n, 2) in squares, each shared among the four middles about it."""
    low = np.floor(places).astype(np.int64)
    part = places - low
    stamp = np.zeros(size * size)
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            square = (low[:, 1] + dy) * size + low[:, 0] + dx
            stamp += np.bincount(square, weights * share, minlength=size * size)
    return stamp.reshape(size, size).astype(np.float32)


def _tagged(candidates: Candidates, seen_m: F64, plan_m: F64, sigma_m: float) -> Candidates:
    """The candidates under which a place, seen from the walk's middle, lies near where it is."""
    heading, scale = candidates.poses[:, 2], candidates.scale
    cos, sin = scale * np.cos(heading), scale * np.sin(heading)
    x = candidates.poses[:, 0] + cos * seen_m[0] - sin * seen_m[1] - plan_m[0]
    y = candidates.poses[:, 1] + sin * seen_m[0] + cos * seen_m[1] - plan_m[1]
    square = x**2 + y**2
    likely = candidates.probability * np.exp((square.min() - square) / (2 * sigma_m**2))
    return Candidates(candidates.poses, scale, likely / likely.sum())


def _modes(
    candidates: Candidates, parameters: AnchoringParameters
) -> Iterator[tuple[float, F64, float, F64]]:
    """Probability, mean pose, mean scale and covariance of each cluster, likeliest first."""
    found: list[tuple[float, F64, float, F64]] = []
    left = candidates.probability.copy()
    while left.sum() > 1 - parameters.certainty and len(found) < 8:
        near = _about(candidates.poses, left, parameters)
        share = float(left[near].sum())
        weights = left[near] / share
        pose, spread = mean_pose(candidates.poses[near], weights)
        scale = float(weights @ candidates.scale[near])
        found.append((share, pose, scale, spread))
        left[near] = 0.0
    yield from sorted(found, key=lambda each: -each[0])


def _about(poses: F64, left: F64, parameters: AnchoringParameters) -> I64:
    """Rows of the cluster about the likeliest candidate, recentred where it is lopsided."""
    centre = poses[int(np.argmax(left))]
    near = np.empty(0, dtype=np.int64)
    for _ in range(RECENTRINGS):
        gap_m = np.linalg.norm(poses[:, :2] - centre[:2], axis=1)
        turn = np.abs(wrap_angle(poses[:, 2] - centre[2]))
        near = np.flatnonzero(
            (gap_m <= parameters.near_m) & (turn <= parameters.near_rad) & (left > 0)
        )
        centre, _ = mean_pose(poses[near], left[near] / left[near].sum())
    return near


def _of_origin(pose: F64, scale: float, middle: F64) -> F64:
    """The placement of the map's origin, given that of the walk's middle."""
    return np.append(placed(-middle[None, :], pose, scale)[0], pose[2])


def _off_share(xy_m: F64, weights: F64, ground: FloorGrid, gap_m: float) -> float:
    """The share of a walk further than a gap from the ground."""
    margin = int(np.ceil(gap_m / ground.cell_m)) + 1
    free = np.pad(ground.free, margin)
    if not free.any():
        return 1.0
    near = distance_transform_edt(~free) * ground.cell_m <= gap_m
    reached = FloorGrid(near, ground.corner_m - margin * ground.cell_m, ground.cell_m)
    return float(weights[~reached.holds(xy_m)].sum() / weights.sum())
