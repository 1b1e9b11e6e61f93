"""Maps: spots with positions and what they sound like, how far to trust them, and superimposed.

A superimposed map has one feature per spot for all orientations (paper, map superimposition).
"""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from elfslam.base.arrays import F32, F64, I64, Bool, Value, array
from elfslam.base.geometry import interpolate_poses
from elfslam.base.parameters import parameter
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, Features, FloorMap, Payload, Trajectory


@dataclass(frozen=True)
class FloorMapParameters:
    """How a walk becomes spots."""

    window_s: float = parameter(0.6, "s", "echoes around a spot that make its feature", 0.1, 60.0)


def trajectory_map(
    trajectory: Trajectory,
    features: Features,
    parameters: FloorMapParameters,
    *,
    parameters_digest: str,
    source: str,
) -> FloorMap:
    """The map of one walk: a spot per echo, so that half a footstep is not the floor of the error.

    A spot's ELF is the mean over the echoes within the window about it. Echoes before the first
    and after the last footstep have no position and give no spot.
    """
    inside = (features.t_s >= trajectory.t_s[0]) & (features.t_s <= trajectory.t_s[-1])
    t_s = features.t_s[inside]
    poses = interpolate_poses(trajectory.t_s, trajectory.world_from_body, t_s)
    node = np.clip(
        np.searchsorted(trajectory.t_s, t_s, side="right") - 1, 0, len(trajectory.t_s) - 1
    )
    vectors = window_means(features, t_s, parameters.window_s)
    return FloorMap(
        xy_m=poses[:, :2],
        heading_rad=poses[:, 2],
        walk=np.zeros(len(t_s), dtype=np.int64),
        order=np.arange(len(t_s)),
        covariance_m2=trajectory.covariance[node][:, :2, :2],
        payloads=(Payload("elf", features.encoder, vectors),),
        parameters_digest=parameters_digest,
        sources=(source,),
    )


def window_means(features: Features, centres_t_s: F64, window_s: float) -> F32:
    """Mean features (m, d) within half a window of each centre; zero where there is none."""
    first = np.searchsorted(features.t_s, centres_t_s - window_s / 2 - 1e-9)
    last = np.searchsorted(features.t_s, centres_t_s + window_s / 2 + 1e-9)
    sums = np.vstack(
        [np.zeros(features.vectors.shape[1]), np.cumsum(features.vectors, axis=0, dtype=np.float64)]
    )
    counts = np.maximum(last - first, 1)
    return np.asarray((sums[last] - sums[first]) / counts[:, None], dtype=np.float32)


SECTORS = 8
"""Of headings, averaged one by one before a spot's ELF: how often each was walked drops out."""


@dataclass(frozen=True, eq=False)
class SpotEchoes(Value):
    """Echo traces of a floor, and the pose at which each was heard, in the frame of the floor."""

    samples: F32 = array("n", ECHO_SAMPLES, dtype=np.float32)
    xy_m: F64 = array("n", 2)
    heading_rad: F64 = array("n")


def floor_spots(xy_m: F64, spacing_m: float) -> F64:
    """The spots (m, 2) of a floor: the middle of what was heard in each square that was entered."""
    squares = np.floor(xy_m / spacing_m).astype(np.int64)
    _, square = np.unique(squares, axis=0, return_inverse=True)
    square = square.reshape(-1)
    count = np.bincount(square)
    middle = [np.bincount(square, weights=column) / count for column in xy_m.T]
    return np.column_stack(middle)


def spot_means(spots_m: F64, heard: Iterable[tuple[F64, F64, F32]]) -> F32:
    """Features (m, 128) of spots (m, 2): the mean over headings of what is nearest to each.

    What was `heard` comes as positions (n, 2), headings (n) and features (n, 128). Each of eight
    sectors of heading is averaged by itself, then those that were heard; a spot that nobody heard
    has zeros. The mean is not normalised: a spot whose orientations still differ is the less sure.
    """
    tree, cells = KDTree(spots_m), len(spots_m) * SECTORS
    sums, counts = np.zeros((cells, ELF_SIZE)), np.zeros(cells)
    for xy_m, heading_rad, vectors in heard:
        cell = tree.query(xy_m)[1] * SECTORS + _sector(heading_rad)
        np.add.at(sums, cell, vectors)
        counts += np.bincount(cell, minlength=cells)
    means = (sums / np.maximum(counts, 1)[:, None]).reshape(len(spots_m), SECTORS, -1)
    sectors = np.maximum((counts.reshape(-1, SECTORS) > 0).sum(axis=1), 1)
    return np.asarray(means.sum(axis=1) / sectors[:, None], dtype=np.float32)


def superimposed(floor_map: FloorMap, elfs: Payload, spacing_m: float) -> FloorMap:
    """A map of many walks with its spots put together, and the mean of their `elfs` in each."""
    spots_m = floor_spots(floor_map.xy_m, spacing_m)
    vectors = spot_means(spots_m, [(floor_map.xy_m, floor_map.heading_rad, elfs.vectors)])
    return superimposed_map(
        spots_m, vectors, elfs.encoder, spacing_m=spacing_m, sources=floor_map.sources,
        covariance_m2=nearest_covariance(floor_map, spots_m),
    )  # fmt: skip


def superimposed_map(
    spots_m: F64,
    vectors: F32,
    encoder: str,
    *,
    spacing_m: float,
    sources: tuple[str, ...],
    covariance_m2: F64 | float = 0.0,
) -> FloorMap:
    """One spot for all orientations as a floor map; its headings say nothing and are zero.

    A spot is as sure as its square is wide, and less by `covariance_m2` (m, 2, 2), that of the
    walks. `encoder` is the identity of what made the `vectors`.
    """
    count = len(spots_m)
    square_m2 = np.tile(np.eye(2) * spacing_m**2 / 12, (count, 1, 1))
    return FloorMap(
        xy_m=spots_m,
        heading_rad=np.zeros(count),
        walk=np.zeros(count, dtype=np.int64),
        order=np.arange(count),
        covariance_m2=square_m2 + covariance_m2,
        payloads=(Payload("elf", encoder, vectors),),
        parameters_digest="",
        sources=sources,
    )


def nearest_covariance(floor_map: FloorMap, spots_m: F64) -> F64:
    """How sure (m, 2, 2) the walks of a map are of where spots (m, 2) lie: that of the nearest."""
    nearest = KDTree(floor_map.xy_m).query(spots_m)[1]
    return np.asarray(floor_map.covariance_m2[nearest])


def _sector(heading_rad: F64) -> I64:
    """Which of the sectors a heading lies in; the four quarters are in the middle of theirs."""
    return np.rint(heading_rad / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS


BLOCK_ROWS = 512


@dataclass(frozen=True)
class QualityParameters:
    """How the quality of a map is told."""

    cell_m: float = parameter(1.0, "m", "side of a square that is judged", 0.1, 100.0)
    asked: int = parameter(4000, "", "spots that are looked for in the map", 1, 10**6)


@dataclass(frozen=True, eq=False)
class MapQuality(Value):
    """Squares (c) that hold spots: their middle, walks and spots in them, and how good they are.

    `weight` is the mean of the spots', `sigma_m` the root mean square per axis of their positions.
    `error_m` is the median distance at which other walks are most similar, NaN where no other
    walk is near. `changed` is where the surroundings have changed since most spots were made.
    """

    xy_m: F64 = array("c", 2)
    walks: I64 = array("c", dtype=np.int64)
    spots: I64 = array("c", dtype=np.int64)
    weight: F64 = array("c")
    sigma_m: F64 = array("c")
    error_m: F64 = array("c", finite=False)
    changed: Bool = array("c", dtype=np.bool_)


def map_quality(floor_map: FloorMap, parameters: QualityParameters) -> MapQuality:
    """The quality of a map, square by square, those without a spot left out."""
    corners = np.floor(floor_map.xy_m / parameters.cell_m).astype(np.int64)
    cells, cell = np.unique(corners, axis=0, return_inverse=True)
    cell = np.asarray(cell).reshape(-1)
    spots = np.bincount(cell, minlength=len(cells))
    variance_m2 = np.trace(floor_map.covariance_m2, axis1=1, axis2=2) / 2
    visits = np.unique(np.column_stack([cell, floor_map.walk]), axis=0)

    def mean(values: F64) -> F64:
        return np.bincount(cell, values, minlength=len(cells)) / spots

    return MapQuality(
        xy_m=np.asarray((cells + 0.5) * parameters.cell_m, dtype=np.float64),
        walks=np.bincount(visits[:, 0], minlength=len(cells)),
        spots=spots,
        weight=mean(floor_map.weight),
        sigma_m=np.sqrt(mean(variance_m2)),
        error_m=_error_m(floor_map, cell, len(cells), parameters),
        changed=mean(floor_map.changed.astype(np.float64)) > 0.5,
    )


def _error_m(floor_map: FloorMap, cell: I64, cells: int, parameters: QualityParameters) -> F64:
    """The median error (c) of finding each square's spots by what the other walks sound like."""
    elf = next((item.vectors for item in floor_map.payloads if item.kind == "elf"), None)
    median_m = np.full(cells, np.nan)
    if elf is None or len(np.unique(floor_map.walk)) < 2:
        return median_m
    count = len(elf)
    asked = np.unique(np.linspace(0, count - 1, min(parameters.asked, count)).astype(int))
    nearest = np.empty(len(asked), dtype=np.int64)
    for first in range(0, len(asked), BLOCK_ROWS):
        rows = asked[first : first + BLOCK_ROWS]
        scores = elf[rows] @ elf.T
        scores[floor_map.walk[rows][:, None] == floor_map.walk] = -np.inf
        nearest[first : first + len(rows)] = scores.argmax(axis=1)
    off_m = np.linalg.norm(floor_map.xy_m[asked] - floor_map.xy_m[nearest], axis=1)
    for one in np.unique(cell[asked]):
        median_m[one] = np.median(off_m[cell[asked] == one])
    return median_m
