"""The pose graph while the walk goes on: every footstep and every closure as it comes.

The poses are kept by incremental smoothing (Kaess et al., IJRR 2012, "iSAM2"). A closure must fit
what the graph predicts there. One that fits far better than chance is believed at once; another
waits until enough closures near it say the same by dead reckoning, and they are believed together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import gtsam
import numpy as np
from scipy.stats import chi2

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose
from elfslam.base.values import PoseGraph
from elfslam.line.graph.build import LEAST_SIGMA
from elfslam.line.graph.choose import Fit, bent, log_odds
from elfslam.line.graph.linear import carried, chi_square, jacobians
from elfslam.line.graph.parameters import GraphParameters
from elfslam.line.graph.runs import Chain, find_runs, forward

RELINEARISED_FROM = 0.1
"""m, rad: poses that moved further than this are linearised anew."""
MOST_WAITING = 256
"""Of the closures that wait the oldest are forgotten."""


class Answer(StrEnum):
    """What became of a closure."""

    BELIEVED = "believed"
    WAITING = "waiting"
    REFUSED = "refused"


@dataclass
class Rows:
    """Rows that can be added to without copying them all each time."""

    held: F64
    count: int = 0

    def add(self, row: F64) -> None:
        """One more row at the end."""
        if self.count == len(self.held):
            self.held = np.concatenate([self.held, np.zeros_like(self.held)])
        self.held[self.count] = row
        self.count += 1

    def all(self) -> F64:
        """The rows so far: a view."""
        return self.held[: self.count]


@dataclass(frozen=True, eq=False)
class Closure:
    """Poses i and j, the measured i_from_j (3) and its covariance (3, 3)."""

    i: int
    j: int
    i_from_j: F64
    covariance: F64


class LiveGraph:
    """The one thing in the back end that has a state: a walk so far.

    `believed` and `waiting` list closures; what was refused is forgotten. Poses are numbered from
    0, which stays where it is.
    """

    def __init__(self, start: F64, parameters: GraphParameters) -> None:
        """Begin at the pose `start` (3)."""
        self.parameters = parameters
        self.believed: list[Closure] = []
        self.waiting: list[Closure] = []
        self._odometry = Rows(np.zeros((1024, 3)))
        self._growth = Rows(np.zeros((1024, 3, 3)))
        self._moves = Rows(np.zeros((1024, 3)))
        self._sigmas = Rows(np.zeros((1024, 3)))
        self._odometry.add(start)
        self._growth.add(np.zeros((3, 3)))
        settings = gtsam.ISAM2Params()
        settings.setRelinearizeThreshold(RELINEARISED_FROM)
        settings.relinearizeSkip = 1
        self._solver = gtsam.ISAM2(settings)
        noise = gtsam.noiseModel.Isotropic.Sigma(3, parameters.anchor_sigma)
        anchor = gtsam.PriorFactorPose2(0, gtsam.Pose2(*start), noise)
        self._solver.update(_factors([anchor]), _value(0, gtsam.Pose2(*start)))

    def __len__(self) -> int:
        """How many poses there are."""
        return self._odometry.count

    def step(self, move: F64, sigma: F64) -> F64:
        """Go on by a move (3) with its sigmas (3), as in `Odometry`; the new pose (3).

        Raises InputError where the move claims to have no error.
        """
        if (np.asarray(sigma) < LEAST_SIGMA).any():
            raise InputError(f"odometry: wanted sigmas of at least {LEAST_SIGMA:g}, got {sigma}")
        last, measured = len(self) - 1, gtsam.Pose2(*move)
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigma)
        factor = gtsam.BetweenFactorPose2(last, last + 1, measured, noise)
        guess = self._solver.calculateEstimatePose2(last).compose(measured)
        self._solver.update(_factors([factor]), _value(last + 1, guess))
        self._moves.add(move)
        self._sigmas.add(sigma)
        self._odometry.add(compose(self._odometry.all()[-1], move))
        error = carried(self._odometry.all()[-1], np.diag(np.square(sigma)))
        self._growth.add(self._growth.all()[-1] + error)
        return self.pose(last + 1)

    def close(self, closure: Closure) -> Answer:
        """Hear of a closure; whether it is believed, waits for company, or is refused.

        Raises InputError where one of its poses does not exist yet.
        """
        if not (0 <= closure.i < len(self) and 0 <= closure.j < len(self)):
            raise InputError(
                f"closure: joins poses {closure.i} and {closure.j}, wanted 0 to {len(self) - 1}; "
                "add the footsteps first"
            )
        fit = self._fit(closure)
        if fit.squared[0] > self._limit():
            return Answer.REFUSED
        if log_odds(fit, self._odometry.all())[0] >= np.log(self.parameters.least_odds):
            self._believe([closure])
            return Answer.BELIEVED
        self.waiting = [*self.waiting[1 - MOST_WAITING :], closure]
        company = self._company()
        if len(company) < self.parameters.run_closures:
            return Answer.WAITING
        self.waiting = [one for one in self.waiting if one not in company]
        self._believe([one for one in company if self._fit(one).squared[0] <= self._limit()])
        return Answer.BELIEVED

    def pose(self, k: int) -> F64:
        """Pose k (3) as it is known now."""
        pose = self._solver.calculateEstimatePose2(k)
        return np.array([pose.x(), pose.y(), pose.theta()])

    def poses(self) -> F64:
        """All poses (n, 3) as they are known now."""
        estimate = self._solver.calculateEstimate()
        known = (estimate.atPose2(k) for k in range(len(self)))
        return np.array([(pose.x(), pose.y(), pose.theta()) for pose in known])

    def covariance(self, k: int) -> F64:
        """The covariance (3, 3) of pose k, x and y in world axes."""
        turn = self.pose(k) * [0.0, 0.0, 1.0]
        return carried(turn, self._solver.marginalCovariance(k))

    def graph(self) -> PoseGraph:
        """The steps and the closures believed so far, for solving them all at once."""
        count = len(self) - 1
        steps = np.column_stack([np.arange(count), np.arange(1, count + 1)])
        closures = as_graph(self._odometry.all(), self.believed)
        return PoseGraph(
            self._odometry.all(),
            np.vstack([steps, closures.edges]),
            np.vstack([self._moves.all(), closures.measurements]),
            np.concatenate([np.eye(3) / self._sigmas.all()[:, None] ** 2, closures.information]),
            np.arange(count + len(self.believed)) >= count,
        )

    def _limit(self) -> float:
        return float(chi2.ppf(self.parameters.inlier_probability, 3))

    def _fit(self, closure: Closure) -> Fit:
        """How a closure fits what the graph predicts there."""
        i, j = closure.i, closure.j
        ends = np.stack([self.pose(i), self.pose(j)])
        residual, near, far = jacobians(ends, np.array([[0, 1]]), closure.i_from_j[None])
        joint = self._solver.jointMarginalCovariance([i, j])
        across = near[0] @ joint.at(i, j) @ far[0].T
        predicted = near[0] @ joint.at(i, i) @ near[0].T + far[0] @ joint.at(j, j) @ far[0].T
        covariance = bent((predicted + across + across.T + closure.covariance)[None])
        return Fit(residual, covariance, chi_square(residual, covariance))

    def _company(self) -> list[Closure]:
        """The waiting closures that agree with the newest of them, itself included."""
        chain = Chain(self._odometry.all(), self._growth.all())
        closures = forward(as_graph(self._odometry.all(), self.waiting))
        runs = find_runs(chain, closures, self.parameters.run_reach, self._limit())
        together = np.flatnonzero(runs.run == runs.run[-1])
        return [self.waiting[k] for k in together]

    def _believe(self, closures: list[Closure]) -> None:
        factors = [
            gtsam.BetweenFactorPose2(
                one.i,
                one.j,
                gtsam.Pose2(*one.i_from_j),
                gtsam.noiseModel.Gaussian.Covariance(one.covariance),
            )
            for one in closures
        ]
        self._solver.update(_factors(factors), gtsam.Values())
        self.believed += closures


def as_graph(poses: F64, closures: list[Closure]) -> PoseGraph:
    """Closures as a graph without steps."""
    ends: I64 = np.array([(one.i, one.j) for one in closures], dtype=np.int64).reshape(-1, 2)
    moves = np.array([one.i_from_j for one in closures]).reshape(-1, 3)
    information = np.array([np.linalg.inv(one.covariance) for one in closures]).reshape(-1, 3, 3)
    return PoseGraph(poses, ends, moves, information, np.ones(len(closures), dtype=np.bool_))


def _value(key: int, pose: gtsam.Pose2) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(key, pose)
    return values


def _factors(factors: Sequence[gtsam.NoiseModelFactor]) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    return graph
