"""Loop closure detection by sequence matching and a ratio test against competing places.

A single pair of footsteps says little. Similarity is averaged along the diagonal, for a stretch
walked again, and along the antidiagonal, for one walked back. Its ridges are candidates. Dead
reckoning rules out those it cannot have missed by so much, and of two candidates that would put
the walker at two places at once only the clearly better one stays. The graph has the last word.

Walked back, the two sides of a hall that is nearly the same after half a turn sound alike, and an
ELF hardly knows its own place from the other side. So stretches walked back must be more similar.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.spatial import cKDTree
from scipy.stats import chi2

from elfslam.base.arrays import F32, F64, I64, Bool, Value, array
from elfslam.base.geometry import wrap_angle
from elfslam.base.parameters import parameter
from elfslam.base.values import (
    NO_CLOSURES,
    AnySimilarity,
    Closures,
    Features,
    MeanSimilarity,
    Odometry,
)


def footstep_means(features: Features, footsteps_t_s: F64) -> F32:
    """Mean feature (n-1, d) of the echoes between footsteps k and k+1; zero where there is none.

    The mean of unit vectors is kept as it is: its dot products are then exactly the means of the
    pairwise cosines, which is the ESS (paper, section 5.3.1); but for what noise took of them.
    """
    means = np.nan_to_num(features.means_between(footsteps_t_s))
    return means / np.float32(features.attenuation)


def echo_sequence_similarity(features: Features, nodes: Odometry) -> MeanSimilarity:
    """ESS between all footsteps, symmetric."""
    means = footstep_means(features, nodes.t_s)
    return MeanSimilarity(means, kind=f"elf:{features.encoder}")


class Drift:
    """The covariance of the way from one node to a later one, for any pair, from sums kept once.

    Steps err independently, each with its own sigmas; a heading error swings all that follows. The
    odometry's `scale_sigma` and `heading_drift_sigma_radps` bear on all steps alike.
    """

    def __init__(self, odometry: Odometry) -> None:
        self._poses, self._t_s = odometry.world_from_body, odometry.t_s
        self._scale_sigma = odometry.scale_sigma
        self._heading_drift_sigma_radps = odometry.heading_drift_sigma_radps
        turn = odometry.step_sigma[:, 2] ** 2
        # Relative to the middle of the walk: far from the origin the sums below would cancel.
        self._xy_m = self._poses[:, :2] - self._poses[:, :2].mean(axis=0)
        after = self._xy_m[1:]
        self._steps = _summed(_step_covariances(odometry))
        self._turns = _summed(turn)
        self._swings = _summed(turn[:, None] * after)
        self._drifts = _summed(np.diff(self._t_s)[:, None] * after)
        self._squares = _summed(turn[:, None, None] * after[:, :, None] * after[:, None, :])

    def covariances(self, i: I64, j: I64) -> F64:
        """Covariance (k, 3, 3) of x, y and heading of nodes j as seen from nodes i <= j.

        In the axes of the odometry, m and rad; to first order.
        """
        end = self._xy_m[j]
        turns, swings = self._turns[j] - self._turns[i], self._swings[j] - self._swings[i]
        lever = turns[:, None] * end - swings
        cross = end[:, :, None] * swings[:, None, :]
        spread = turns[:, None, None] * end[:, :, None] * end[:, None, :]
        spread += self._squares[j] - self._squares[i] - cross - np.swapaxes(cross, 1, 2)
        way = end - self._xy_m[i]
        covariance = np.zeros((len(end), 3, 3))
        covariance[:, :2, :2] = self._steps[j] - self._steps[i] + _turned(spread)
        covariance[:, :2, :2] += self._scale_sigma**2 * way[:, :, None] * way[:, None, :]
        covariance[:, :2, 2] = covariance[:, 2, :2] = np.column_stack([-lever[:, 1], lever[:, 0]])
        covariance[:, 2, 2] = turns
        return np.asarray(covariance + self._steady_turn(i, j))

    def _steady_turn(self, i: I64, j: I64) -> F64:
        """What a heading that drifts steadily adds (k, 3, 3)."""
        lasting_s = self._t_s[j] - self._t_s[i]
        lever = lasting_s[:, None] * self._xy_m[j] - (self._drifts[j] - self._drifts[i])
        swing = np.column_stack([-lever[:, 1], lever[:, 0], lasting_s])
        return np.asarray(
            self._heading_drift_sigma_radps**2 * swing[:, :, None] * swing[:, None, :]
        )

    def disagreement(self, i: I64, j: I64, turn_rad: F64 | float, slack: F64) -> F64:
        """Squared Mahalanobis distance (k) of "node j is where node i is, turned by `turn_rad`".

        `slack` (3, m m rad) is how exactly "where" is meant, one sigma per axis. With three
        degrees of freedom.
        """
        way = self._poses[j] - self._poses[i]
        way[:, 2] = wrap_angle(way[:, 2] - turn_rad)
        covariance = self.covariances(i, j) + np.diag(np.square(slack))
        return np.asarray(np.einsum("ki,ki->k", way, _solved(covariance, way)))


def _solved(covariance: F64, way: F64) -> F64:
    return np.asarray(np.linalg.solve(covariance, way[:, :, None])[:, :, 0])


def _summed(terms: F64) -> F64:
    """Sums (n+1, ...) of the first k terms."""
    return np.concatenate([np.zeros((1, *terms.shape[1:])), np.cumsum(terms, axis=0)])


def _step_covariances(odometry: Odometry) -> F64:
    """Covariance (n-1, 2, 2) of each step's end, forward and lateral turned into the axes."""
    heading_rad = odometry.world_from_body[:-1, 2]
    forward = np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    variance = odometry.step_sigma**2
    along = variance[:, 0, None, None] * forward[:, :, None] * forward[:, None, :]
    return np.asarray(along + variance[:, 1, None, None] * left[:, :, None] * left[:, None, :])


def _turned(spread: F64) -> F64:
    """The same second moments (k, 2, 2) of vectors turned by a right angle."""
    return np.asarray(spread[:, ::-1, ::-1].swapaxes(1, 2) * np.array([[1.0, -1.0], [-1.0, 1.0]]))


AGAIN, BACK = 1, -1
"""Ways of walking a stretch a second time."""
Prior = Callable[[Closures], tuple[F64, F64]]
"""Of closures (k), the log odds that they hold before their score is known, and the information
that they bring if so; both in nats."""
USUAL_LEAD = 0.05
"""By how much closures usually exceed their threshold: to these the stated sigmas belong."""
LEAST_SIGMA_SHARE = 0.5
"""Of the stated sigmas, what remains however similar two stretches are."""
Rows = Callable[[int, int], F32]
"""The similarities of some footsteps, from one to another without the last, to all others."""
DEGREES_OF_FREEDOM = 3
Found = TypeVar("Found", bound=Value)


@dataclass(frozen=True)
class ClosureParameters:
    """What counts as a loop closure."""

    threshold: float = parameter(
        0.22, "", "mean similarity along a sequence that makes a candidate", -1.0, 1.0
    )
    back_margin: float = parameter(
        0.4, "", "how much more similar a stretch walked back must be", 0.0, 2.0
    )
    near_footsteps: int = parameter(
        12, "footsteps", "neighbours in time are not closures", 1, 10_000
    )
    half_sequence: int = parameter(6, "footsteps", "averaged before and after a footstep", 0, 200)
    half_peak: int = parameter(
        2, "footsteps", "the same over which a ridge is placed exactly", 0, 200
    )
    ridge_footsteps: int = parameter(
        3, "footsteps", "a candidate is the best this far to either side", 1, 100
    )
    rival_margin: float = parameter(
        0.05, "", "by how much a candidate must beat those it contradicts", 0.0, 2.0
    )
    gate_probability: float = parameter(
        0.999, "", "a pair that dead reckoning holds for less likely is dropped", 0.5, 1.0
    )
    along_sigma_m: float = parameter(0.20, "m", "error of a closure along the walk", 0.01, 100.0)
    across_sigma_m: float = parameter(0.28, "m", "error of a closure across the walk", 0.01, 100.0)
    heading_sigma_rad: float = parameter(0.28, "rad", "error of a closure's heading", 0.01, 3.14)
    sigma_fall: float = parameter(
        6.0, "", "rate at which a closure's position sigmas fall with its similarity", 0.0, 100.0
    )
    shared_footsteps: int = parameter(
        3, "footsteps", "closures this near each other share one error", 0, 1_000
    )
    score_evidence: float = parameter(
        30.0, "nats", "log-likelihood ratio that a unit of similarity is worth", 0.1, 1e4
    )
    most_earned: float = parameter(
        4.0, "nats", "most that a prior counts in guided matching; 0: no such", 0.0, 100.0
    )
    least_gain: float = parameter(
        1.0, "nats", "information that a closure by guided matching must bring", 0.0, 100.0
    )


@dataclass(frozen=True, eq=False)
class ClosureCandidates(Value):
    """Pairs i < j (k) with their similarity, the partner between footsteps, and the way walked.

    Between two walks i is a footstep of the one and j of the other, in any order.
    """

    i: I64 = array("k", dtype=np.int64)
    j: I64 = array("k", dtype=np.int64)
    score: F64 = array("k")
    line_j: F64 = array("k")
    direction: I64 = array("k", dtype=np.int64)


def find_closures(
    similarity: AnySimilarity,
    nodes: Odometry,
    parameters: ClosureParameters,
    level: F64 | None = None,
) -> Closures:
    """Pairs of footsteps at the same place, with the relative pose that each implies.

    Half a turn of heading where the stretch was walked the other way. None between footsteps of
    which the `level` (n) differs, or is NaN.
    """
    drift = Drift(nodes)
    found = _possible(similarity, drift, parameters, level)
    found = found.chosen(passes_ratio_test(found, drift, parameters))
    found = found.chosen(has_full_window(found, similarity.count, parameters))
    return _as_closures(found, nodes, parameters)


def guided_closures(
    similarity: AnySimilarity,
    nodes: Odometry,
    known: Closures,
    prior: Prior,
    parameters: ClosureParameters,
    level: F64 | None = None,
) -> Closures:
    """Guided matching: pairs beside the `known` ones, at a threshold that the `prior` earns.

    Posterior log odds are the log-likelihood ratio of the score, counted from the threshold, and
    the prior log odds. What a solution knows already would add only its own error. None where
    the prior may earn nothing.
    """
    if not parameters.most_earned:
        return NO_CLOSURES
    drift = Drift(nodes)
    lowered = parameters.threshold - parameters.most_earned / parameters.score_evidence
    found = _possible(similarity, drift, replace(parameters, threshold=lowered), level)
    found = found.chosen(has_full_window(found, similarity.count, parameters))
    log_odds, gain = prior(_as_closures(found, nodes, parameters))
    earned = np.minimum(log_odds, parameters.most_earned) / parameters.score_evidence
    likely = (found.score + earned >= _wanted(found, parameters)) & (gain >= parameters.least_gain)
    found, posterior = found.chosen(likely), (found.score + earned)[likely]
    clear = passes_ratio_test(replace(found, score=posterior), drift, parameters)
    return _as_closures(found.chosen(clear & ~_among(found, known)), nodes, parameters)


def _possible(
    similarity: AnySimilarity,
    drift: Drift,
    parameters: ClosureParameters,
    level: F64 | None,
) -> ClosureCandidates:
    """The candidates on one level that dead reckoning allows."""
    found = candidates(similarity, parameters)
    if level is not None:
        found = found.chosen(level[found.i] == level[found.j])
    return found.chosen(within_gate(found, drift, parameters))


def _wanted(found: ClosureCandidates, parameters: ClosureParameters) -> F64:
    """The score (k) that makes a candidate by itself."""
    back = found.direction == BACK
    return np.asarray(parameters.threshold + parameters.back_margin * back)


def _among(found: ClosureCandidates, known: Closures) -> Bool:
    """Which candidates (k) are closures already."""
    far = max(np.max(each, initial=0) for each in (found.j, known.j)) + 1
    return np.isin(found.i * far + found.j, known.i * far + known.j)


def _as_closures(
    found: ClosureCandidates, nodes: Odometry, parameters: ClosureParameters
) -> Closures:
    """The candidates with their relative poses: the less similar, the further aside."""
    above = found.score - _wanted(found, parameters) - USUAL_LEAD
    share = np.maximum(np.exp(-parameters.sigma_fall * above), LEAST_SIGMA_SHARE)
    covariance = _covariances(found, parameters)
    covariance[:, :2] *= np.square(share)[:, None, None]
    return Closures(found.i, found.j, found.score, _i_from_j(found, nodes), covariance)


def sharing_errors(closures: Closures, reach: int) -> Closures:
    """The closures with wider sigmas where they lie within `reach` footsteps of others.

    What errs alike says no more together than one alone: each of n such weighs an nth.
    """
    if not len(closures.i):
        return closures
    tree = cKDTree(np.column_stack([closures.i, closures.j]))
    alike = tree.query_ball_point(tree.data, reach, p=np.inf, return_length=True)
    return replace(closures, covariance=alike[:, None, None] * closures.covariance)


def candidates(similarity: AnySimilarity, parameters: ClosureParameters) -> ClosureCandidates:
    """Ridges of the averaged similarity, for stretches walked again and walked back."""
    found = _all_ridges(similarity.rows, similarity.count, similarity.count, parameters)
    return found.chosen(found.j - found.i >= parameters.near_footsteps)


def candidates_between(one: F32, other: F32, parameters: ClosureParameters) -> ClosureCandidates:
    """The same between two walks, by the mean features (n, d) and (m, d) of their footsteps."""

    def rows(first: int, last: int) -> F32:
        return np.asarray(one[first:last] @ other.T)

    return _all_ridges(rows, len(one), len(other), parameters)


def closures_between(one: F32, other: F32, poses: F64, parameters: ClosureParameters) -> Closures:
    """Places of two walks that sound alike: i of the one and j of the other, in any order.

    `one` (n, d) and `other` (m, d) are what is heard from each footstep to the next, `poses`
    (m, 3) the middles of the other's stretches; the relative poses lead from middle to middle.
    """
    found = candidates_between(one, other, parameters)
    steps_m = np.linalg.norm(np.diff(poses[:, :2], axis=0, append=poses[-1:, :2]), axis=1)
    ahead_m = (found.j - found.line_j) * found.direction * steps_m[found.j]
    turn_rad = np.where(found.direction == BACK, np.pi, 0.0)
    i_from_j = np.column_stack([ahead_m, np.zeros(len(ahead_m)), turn_rad])
    return Closures(found.i, found.j, found.score, i_from_j, _covariances(found, parameters))


def _all_ridges(
    rows: Rows, count: int, columns: int, parameters: ClosureParameters
) -> ClosureCandidates:
    """Ridges anywhere in a matrix (count, columns), block of rows by block."""
    block = _block_rows(columns)
    parts = [
        _ridges(rows, first, min(first + block, count), count, direction, parameters)
        for first in range(0, count, block)
        for direction in (AGAIN, BACK)
    ]
    return joined(parts)


def has_full_window(found: ClosureCandidates, count: int, parameters: ClosureParameters) -> Bool:
    """Which candidates (k) have whole sequences on both sides.

    Who sets off from a corner, or stops there, faces elsewhere than whoever walks past, and a
    first footstep with a wrong heading turns the whole map.
    """
    half = parameters.half_sequence
    return np.asarray((found.i >= half) & (found.j < count - half))


def within_gate(found: ClosureCandidates, drift: Drift, parameters: ClosureParameters) -> Bool:
    """Which candidates (k) dead reckoning allows: its error may be that large by then."""
    turn_rad = np.where(found.direction == AGAIN, 0.0, np.pi)
    distance = drift.disagreement(found.i, found.j, turn_rad, _sigma(parameters))
    return np.asarray(distance <= _gate(parameters))


def passes_ratio_test(
    found: ClosureCandidates, drift: Drift, parameters: ClosureParameters
) -> Bool:
    """Ratio test: which candidates (k) have no competing one of their footstep.

    Two contradict each other where dead reckoning excludes that their other ends are one place.
    The better one stays if it leads by the margin, else neither.
    """
    beaten = np.zeros(len(found.i), dtype=bool)
    for shared, other in ((found.i, found.j), (found.j, found.i)):
        order = np.argsort(shared, kind="stable")
        for distance in range(1, _most_alike(shared)):
            one, two = order[:-distance], order[distance:]
            same = shared[one] == shared[two]
            one, two = one[same], two[same]
            competing = _contradict(other, found.direction, one, two, drift, parameters)
            lead = found.score[one] - found.score[two]
            beaten[one[competing & (lead < parameters.rival_margin)]] = True
            beaten[two[competing & (-lead < parameters.rival_margin)]] = True
    return ~beaten


def _contradict(
    other: I64, direction: I64, one: I64, two: I64, drift: Drift, parameters: ClosureParameters
) -> Bool:
    """Whether the far ends of candidates `one` and `two` (rows) cannot be the same place."""
    turn_rad = np.where(direction[one] == direction[two], 0.0, np.pi)
    earlier, later = np.minimum(other[one], other[two]), np.maximum(other[one], other[two])
    slack = np.sqrt(2) * _sigma(parameters)
    return np.asarray(drift.disagreement(earlier, later, turn_rad, slack) > _gate(parameters))


def _ridges(
    rows: Rows, first: int, last: int, count: int, direction: int, parameters: ClosureParameters
) -> ClosureCandidates:
    """The candidates whose earlier footstep lies in one block of rows."""
    margin = parameters.half_sequence + parameters.ridge_footsteps
    top, bottom = max(first - margin, 0), min(last + margin, count)
    scores = rows(top, bottom)
    mean = sequence_mean(scores, parameters.half_sequence, direction)
    reach = 2 * parameters.ridge_footsteps + 1
    ridge = mean >= np.minimum(maximum_filter1d(mean, reach, 0), maximum_filter1d(mean, reach, 1))
    inside = slice(first - top, last - top)
    least = parameters.threshold + (parameters.back_margin if direction == BACK else 0.0)
    i, j = np.nonzero(ridge[inside] & (mean[inside] >= least))
    i = i + first - top
    peak = sequence_mean(scores, parameters.half_peak, direction)
    score, line_j = mean[i, j].astype(np.float64), j + _offset(peak, i, j)
    return ClosureCandidates(i + top, j, score, line_j, np.full(len(i), direction))


def sequence_mean(scores: F32, half: int, direction: int) -> F32:
    """Means (n, m) over up to `half` rows before and after, one column on for each row.

    Or one column back, where `direction` is BACK. Shorter at the edges.
    """
    rows, columns = scores.shape
    total, count = np.zeros_like(scores), np.zeros_like(scores)
    for k in range(-min(half, rows - 1), min(half, rows - 1) + 1):
        aside = k * direction
        to = (slice(max(0, -k), rows - max(0, k)), slice(max(0, -aside), columns - max(0, aside)))
        of = (slice(max(0, k), rows - max(0, -k)), slice(max(0, aside), columns - max(0, -aside)))
        total[to] += scores[of]
        count[to] += 1
    return np.asarray(total / count)


def _offset(mean: F32, i: I64, j: I64) -> F64:
    """How far beside column j the parabola through it and its neighbours peaks, in columns.

    Zero in the first and last column, which have a neighbour on one side only.
    """
    if mean.shape[1] < 3:
        return np.zeros(len(i))
    inside = np.clip(j, 1, mean.shape[1] - 2)
    left, at, right = (mean[i, inside + k].astype(np.float64) for k in (-1, 0, 1))
    curvature = np.minimum(2 * (left - 2 * at + right), -1e-3)
    return np.where(inside == j, np.clip((left - right) / curvature, -1.0, 1.0), 0.0)


def _i_from_j(found: ClosureCandidates, nodes: Odometry) -> F64:
    """Relative poses (k, 3): how far footstep j lies ahead of footstep i, and its turn."""
    steps_m = np.linalg.norm(np.diff(nodes.world_from_body[:, :2], axis=0), axis=1)
    back = found.direction == BACK
    # Walking back, stretch j begins where stretch i ends: a step ahead of footstep i.
    ahead = (found.j - found.line_j) * found.direction + back
    forward_m = ahead * steps_m[np.minimum(found.j, len(steps_m) - 1)]
    return np.column_stack([forward_m, np.zeros(len(back)), np.where(back, np.pi, 0.0)])


def _covariances(found: ClosureCandidates, parameters: ClosureParameters) -> F64:
    """Covariances (k, 3, 3) of the relative poses."""
    return np.tile(np.diag(np.square(_sigma(parameters))), (len(found.i), 1, 1))


def _sigma(parameters: ClosureParameters) -> F64:
    return np.array(
        [parameters.along_sigma_m, parameters.across_sigma_m, parameters.heading_sigma_rad]
    )


def _gate(parameters: ClosureParameters) -> float:
    return float(chi2.ppf(parameters.gate_probability, DEGREES_OF_FREEDOM))


def _most_alike(values: I64) -> int:
    """How often the most frequent value occurs."""
    return int(np.bincount(values).max()) if len(values) else 0


def _block_rows(count: int) -> int:
    """Rows worked on at a time: a block of them has about four million scores."""
    return max(4_000_000 // max(count, 1), 64)


def joined(parts: Sequence[Found]) -> Found:
    """The closures, or candidates, of several parts as one."""
    columns = (
        np.concatenate([getattr(part, column.name) for part in parts])
        for column in fields(parts[0])  # type: ignore[arg-type]
    )
    return type(parts[0])(*columns)
