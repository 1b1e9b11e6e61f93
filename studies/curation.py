"""Loop closures curated from a similarity matrix (paper, section 5.4).

Candidates above the threshold form lines along the diagonal where a stretch is walked again, and
scattered points where two places only sound alike. The matrix is cut into slices of 16 footsteps,
DBSCAN groups the candidates of each slice, RANSAC keeps a line per group, and a pair survives only
if its mirror image, curated in another slice, survived as well.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from sklearn.cluster import DBSCAN
from sklearn.linear_model import LinearRegression, RANSACRegressor

from elfslam.base.arrays import F32, F64, I64, Bool
from elfslam.base.values import AnySimilarity, Closures, Odometry

GATHERED_WITHIN = (2.0, 1.5, 1.0)
"""A line is fitted to the points this close, as shares of `line_distance`: one that starts out
skewed cuts off the very points that would turn it back, so the first rounds reach further."""


@dataclass(frozen=True)
class CurationParameters:
    """What the paper's curation takes for a loop closure; lengths are in footsteps."""

    threshold: float = 0.4
    """Similarity from which a pair is a candidate."""
    near_footsteps: int = 12
    """Nearer neighbours in time are no closures."""
    slice_footsteps: int = 16
    cluster_radius: float = 2.0
    """DBSCAN: the neighbourhood."""
    cluster_points: int = 3
    """DBSCAN: candidates that make a core point."""
    line_distance: float = 1.2
    """RANSAC: the farthest inlier."""
    line_points: int = 6
    line_length: int = 5
    """The fewest inliers of a line, and the fewest footsteps that it spans."""
    slopes: tuple[float, float] = (0.6, 1.6)
    """Of a line: the pace of one pass over the other."""
    along_sigma_m: float = 0.18
    across_sigma_m: float = 0.18
    heading_sigma_rad: float = 0.18
    """Errors of a closure along and across the walk, and of its heading."""


@dataclass(frozen=True)
class Curated:
    """Surviving matrix elements (k) and the partner that the line through them predicts."""

    i: I64
    j: I64
    line_j: F64
    slope: F64


def curated_closures(
    similarity: AnySimilarity, nodes: Odometry, parameters: CurationParameters
) -> Closures:
    """Pairs of footsteps at the same place, with the relative pose that each implies."""
    curated = curate(similarity.scores, parameters)
    rows = _one_per_line(curated, similarity.scores)
    i, j = curated.i[rows], curated.j[rows]
    lines, slope = curated.line_j[rows], np.sign(curated.slope[rows])
    step_m = _step_lengths(nodes)
    # Walking back, stretch j begins where stretch i ends: a step ahead of footstep i.
    forward_m = ((j - lines) * slope + (slope < 0)) * step_m[np.minimum(j, len(step_m) - 1)]
    heading = np.where(slope > 0, 0.0, np.pi)
    i_from_j = np.column_stack([forward_m, np.zeros(len(i)), heading])
    sigma = (parameters.along_sigma_m, parameters.across_sigma_m, parameters.heading_sigma_rad)
    covariance = np.tile(np.diag(np.square(sigma)), (len(i), 1, 1))
    score = similarity.scores[i, j].astype(np.float64)
    return Closures(i, j, score, i_from_j, covariance)


def curate(scores: F32, parameters: CurationParameters) -> Curated:
    """Candidates that lie on a line in their slice and whose mirror image does too; i < j."""
    on_lines = pairs_on_lines(scores, parameters)
    pairs = {(int(i), int(j)) for i, j in on_lines[:, :2]}
    mirrored = np.array([(int(j), int(i)) in pairs for i, j in on_lines[:, :2]], dtype=bool)
    earlier = on_lines[:, 0] < on_lines[:, 1]
    kept = on_lines[mirrored & earlier] if len(on_lines) else on_lines
    return Curated(kept[:, 0].astype(int), kept[:, 1].astype(int), kept[:, 2], kept[:, 3])


def pairs_on_lines(scores: F32, parameters: CurationParameters) -> F64:
    """Rows (i, j, j on the line, slope) of the candidates on a line in their slice."""
    candidates = candidate_pairs(scores, parameters)
    slices = [
        _lines_in_slice(candidates[candidates[:, 0] // parameters.slice_footsteps == k], parameters)
        for k in range(-(-len(scores) // parameters.slice_footsteps))
    ]
    return np.vstack([np.zeros((0, 4)), *slices])


def candidate_pairs(scores: F32, parameters: CurationParameters) -> I64:
    """Matrix elements (k, 2) above the threshold and away from the diagonal, both triangles."""
    i, j = np.nonzero(scores >= parameters.threshold)
    far = np.abs(i - j) >= parameters.near_footsteps
    return np.column_stack([i[far], j[far]])


def _lines_in_slice(points: I64, parameters: CurationParameters) -> F64:
    """Rows (i, j, j on the line, slope) of the candidates that a line explains."""
    if len(points) < parameters.cluster_points:
        return np.zeros((0, 4))
    clustering = DBSCAN(eps=parameters.cluster_radius, min_samples=parameters.cluster_points)
    labels = clustering.fit_predict(points)
    lines = [_line(points[labels == label], parameters) for label in range(labels.max() + 1)]
    return np.vstack([np.zeros((0, 4)), *lines])


def _line(points: I64, parameters: CurationParameters) -> F64:
    i, j = points[:, 0].astype(float), points[:, 1].astype(float)
    if not _long_enough(i, parameters):
        return np.zeros((0, 4))
    ransac = RANSACRegressor(
        LinearRegression(),
        min_samples=2,
        residual_threshold=parameters.line_distance,
        is_model_valid=lambda model, *_: _plausible(float(model.coef_[0]), parameters),
        random_state=0,
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ransac.fit(i[:, None], j)
    except ValueError:  # no two candidates make a plausible line
        return np.zeros((0, 4))
    return _inliers(points, ransac.inlier_mask_, parameters)


def _inliers(points: I64, inlier: Bool, parameters: CurationParameters) -> F64:
    """What lies near the best line through the inliers: RANSAC's own is drawn through two only."""
    i, j = points.T.astype(float)
    if np.ptp(i[inlier]) == 0:
        return np.zeros((0, 4))
    for share in GATHERED_WITHIN:
        slope, offset = np.polyfit(i[inlier], j[inlier], 1)
        line_j = slope * i + offset
        inlier = np.abs(j - line_j) <= share * parameters.line_distance
        if not (_long_enough(i[inlier], parameters) and _plausible(slope, parameters)):
            return np.zeros((0, 4))
    return np.column_stack([points, line_j, np.full(len(points), slope)])[inlier]


def _long_enough(i: F64, parameters: CurationParameters) -> bool:
    enough = len(i) >= parameters.line_points
    return enough and bool(np.ptp(i) + 1 >= parameters.line_length)


def _plausible(slope: float, parameters: CurationParameters) -> bool:
    low, high = parameters.slopes
    return low <= abs(slope) <= high


def _one_per_line(curated: Curated, scores: F32) -> I64:
    """Indices of the best pair per footstep i and crossing line: one closure for each revisit."""
    group = np.round(curated.line_j / 4.0).astype(int)
    order = np.argsort(-scores[curated.i, curated.j], kind="stable")
    _, first = np.unique(np.column_stack([curated.i, group])[order], axis=0, return_index=True)
    return np.sort(order[first])


def _step_lengths(nodes: Odometry) -> F64:
    return np.asarray(np.linalg.norm(np.diff(nodes.world_from_body[:, :2], axis=0), axis=1))
