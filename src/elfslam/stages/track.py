"""Particle filter for tracking: particles moved by footsteps and weighted by echoes.

A particle filter (Thrun, Burgard and Fox, Probabilistic Robotics, chapter 8.3, with particles
drawn from the measurement as in Mixture-MCL). Each particle has its own heading and length of step,
so neither has to be known. At every footstep a few particles are drawn anew from what the echoes
alone say: so it starts anywhere, and a wrong fix is not for ever.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from elfslam.base.arrays import F32, F64, I64, Bool, Value, array
from elfslam.base.fixes import NOWHERE, Fix, moments
from elfslam.base.geometry import between, compose, wrap_angle
from elfslam.base.parameters import parameter
from elfslam.base.values import Fixes, FixStatus, FloorMap, Odometry


@dataclass(frozen=True)
class TrackParameters:
    """How particles move, are weighed and renewed, and what a fix is worth."""

    particles: int = parameter(1500, "", "particles of where the walker is", 10, 1_000_000)
    temperature: float = parameter(
        0.14, "", "softmax temperature of a similarity, footstep by footstep", 1e-4, 10.0
    )
    reach_m: float = parameter(
        0.2, "m", "how far from a spot it sounds as there (sigma)", 0.01, 100.0
    )
    heading_reach_rad: float = parameter(
        0.4, "rad", "how far the phone may be turned against the spot (sigma)", 0.01, 100.0
    )
    neighbours: int = parameter(4, "", "nearest spots that explain a particle", 1, 100)
    unexplained: float = parameter(
        0.3, "", "similarity that is granted to particles where no spot is near", -1.0, 1.0
    )
    renewed: float = parameter(
        0.02, "", "share of particles drawn from the echoes alone at each footstep", 0.0, 1.0
    )
    scale_sigma: float = parameter(
        0.08, "", "how much longer or shorter steps may be than reckoned", 0.0, 1.0
    )
    turn_sigma_rad: float = parameter(
        0.06, "rad", "heading error of a footstep, on top of the reckoned", 0.0, 3.14
    )
    memory: float = parameter(
        0.7, "", "weight of the past in the similarity that tells an unknown place", 0.0, 0.99
    )
    unknown_below: float = parameter(
        0.45, "", "remembered similarity at the fix below this is UNKNOWN_PLACE", -1.0, 1.0
    )
    jump: float = parameter(
        0.55,
        "",
        "a place out of reach of the steps that is more similar by this is SUSPECT",
        0.0,
        3.0,
    )
    regained: float = parameter(
        0.16,
        "",
        "once SUSPECT, what is within reach counts again when less similar by no more than this",
        0.0,
        3.0,
    )
    settled: int = parameter(6, "", "OK fixes until a place out of reach is SUSPECT", 1, 1_000_000)
    near_m: float = parameter(
        1.0, "m", "particles this close to the best place are one place", 0.05, 100.0
    )
    ambiguous_below: float = parameter(
        0.7, "", "less belief near the best place is AMBIGUOUS", 0.0, 1.0
    )
    sigma_floor_m: float = parameter(0.10, "m", "least error of a fix per axis", 0.0, 100.0)


@dataclass(frozen=True, eq=False)
class Cloud(Value):
    """Particles (p): pose, how much longer the steps are than reckoned, and weight (sum 1)."""

    poses: F64 = array("p", 3)
    scale: F64 = array("p")
    weight: F64 = array("p")


class Tracker:
    """Follows one walker through a map; the generator alone decides the draws."""

    def __init__(
        self, floor_map: FloorMap, parameters: TrackParameters, generator: np.random.Generator
    ) -> None:
        self._map, self._parameters, self._generator = floor_map, parameters, generator
        self._tree = cKDTree(self._coordinates(floor_map.xy_m, floor_map.heading_rad))
        self._cloud: Cloud | None = None
        self._similarity = np.nan
        self._settled = 0
        self._doubts = False

    def follow(self, nodes: Odometry, scores: F32, suspect: Bool | None = None) -> Fixes:
        """A fix at each of the n footsteps but the first.

        `scores` (n-1, m): how similar each spot is to each stretch between footsteps, rows of NaN
        where nothing was heard; those that are `suspect` (n-1) move nothing. What follows later
        goes on from here.
        """
        moves = between(nodes.world_from_body[:-1], nodes.world_from_body[1:])
        doubt = np.zeros(len(moves), dtype=np.bool_) if suspect is None else suspect
        steps = zip(moves, nodes.step_sigma, scores, doubt, strict=True)
        rows = [self.step(*each, suspect=bool(doubted)) for *each, doubted in steps]
        return Fixes(nodes.t_s[1:], *(np.array(column) for column in zip(*rows, strict=True)))

    def step(self, move: F64, sigma: F64, scores: F32, *, suspect: bool = False) -> Fix:
        """Position, heading, covariance, similarity and status after one footstep.

        `move` (3) as reckoned, in the body frame; `sigma` (3) as in `Odometry`; `scores` (m).
        What is `suspect`, or says of a settled walker what no step explains, is SUSPECT: the
        particles go on by the steps alone.
        """
        heard = not np.isnan(scores[0]) and not suspect
        self._doubts |= suspect
        if self._cloud is None:
            if not heard:
                status = FixStatus.SUSPECT if suspect else FixStatus.NO_ECHO
                return *NOWHERE, np.nan, int(status)
            count = self._parameters.particles
            self._cloud = self._drawn(scores, move, count)
            middle = compose(self._cloud.poses, -_half(move))
        else:
            before = self._cloud.poses
            self._cloud = self._moved(self._cloud, move, sigma)
            middle = _halfway(before, self._cloud.poses)
            if heard:
                suspect = self._doubts = self._jumps(middle, self._cloud.weight, scores)
                heard = not suspect
        if suspect:
            return self._fix(self._cloud, scores, heard=False, suspect=True)
        if heard:
            self._cloud = self._weighed(self._cloud, middle, scores)
        fix = self._fix(self._cloud, scores, heard=heard)
        if heard:
            self._cloud = self._renewed(self._cloud, scores, move)
        self._settled += fix[-1] == FixStatus.OK
        return fix

    def _jumps(self, middle: F64, weight: F64, scores: F32) -> bool:
        """Whether a settled walker is heard where the steps cannot have led.

        Within reach is what lies about the best place, as far as the particles do.
        """
        known = self._parameters
        if self._settled < known.settled:
            return False
        best_m = densest(Cloud(middle, np.ones(len(middle)), weight), known.near_m)
        reach_m = _reach_m(middle[:, :2], best_m, known.near_m)
        around = np.linalg.norm(self._map.xy_m - best_m, axis=1) <= reach_m
        here = float(scores[around].max(initial=-1.0))
        return float(scores.max()) - here > (known.regained if self._doubts else known.jump)

    def _coordinates(self, xy_m: F64, heading_rad: F64) -> F64:
        """Where distance is counted in sigmas of position and heading."""
        known = self._parameters
        direction = np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
        return np.hstack([xy_m / known.reach_m, direction / known.heading_reach_rad])

    def _moved(self, cloud: Cloud, move: F64, sigma: F64) -> Cloud:
        known, count = self._parameters, len(cloud.weight)
        wider = np.array([sigma[0], sigma[1], np.hypot(sigma[2], known.turn_sigma_rad)])
        moves = move + wider * self._generator.normal(size=(count, 3))
        moves[:, :2] += move[:2] * (cloud.scale[:, None] - 1)
        return Cloud(compose(cloud.poses, moves), cloud.scale, cloud.weight)

    def _weighed(self, cloud: Cloud, middle: F64, scores: F32) -> Cloud:
        """Weights times likelihood: the best of the spots around, as near as it is."""
        known = self._parameters
        count = min(known.neighbours, len(scores))
        where = self._coordinates(middle[:, :2], middle[:, 2])
        far, spot = self._tree.query(where, k=range(1, count + 1))
        explained = scores[spot] / known.temperature - far**2 / 2
        log_likelihood = np.maximum(explained.max(axis=1), known.unexplained / known.temperature)
        weight = cloud.weight * np.exp(log_likelihood - log_likelihood.max())
        return Cloud(cloud.poses, cloud.scale, weight / weight.sum())

    def _drawn(self, scores: F32, move: F64, count: int) -> Cloud:
        """Particles from the echoes alone, after the step in whose middle they were heard."""
        known, generator = self._parameters, self._generator
        belief = np.exp((scores - scores.max()).astype(np.float64) / known.temperature)
        shares = np.cumsum(belief)
        spot = np.searchsorted(shares, shares[-1] * _strata(count, generator))
        spot = np.minimum(spot, len(scores) - 1)
        xy_m = self._map.xy_m[spot] + known.reach_m * generator.normal(size=(count, 2))
        heading = self._map.heading_rad[spot]
        heading = heading + known.heading_reach_rad * generator.normal(size=count)
        poses = compose(np.column_stack([xy_m, heading]), _half(move))
        scale = 1 + known.scale_sigma * generator.normal(size=count)
        return Cloud(poses, scale, np.full(count, 1 / count))

    def _renewed(self, cloud: Cloud, scores: F32, move: F64) -> Cloud:
        """Resampling: as many particles, where they weigh, and some drawn from the echoes alone.

        Neighbours lie side by side in the draw, so that each of several places keeps its share.
        """
        count = self._parameters.particles
        fresh = round(self._parameters.renewed * count)
        order = np.lexsort(_cells(cloud.poses[:, :2], self._parameters.near_m).T)
        shares = np.cumsum(cloud.weight[order])
        drawn = np.searchsorted(shares, shares[-1] * _strata(count - fresh, self._generator))
        kept = order[np.minimum(drawn, count - 1)]
        new = self._drawn(scores, move, fresh)
        poses = np.vstack([cloud.poses[kept], new.poses])
        scale = np.concatenate([cloud.scale[kept], new.scale])
        return Cloud(poses, scale, np.full(count, 1 / count))

    def _fix(self, cloud: Cloud, scores: F32, *, heard: bool, suspect: bool = False) -> Fix:
        known = self._parameters
        best_m = densest(cloud, known.near_m)
        reach_m = _reach_m(cloud.poses[:, :2], best_m, known.near_m) if suspect else known.near_m
        near = np.linalg.norm(cloud.poses[:, :2] - best_m, axis=1) <= reach_m
        status = FixStatus.OK
        if cloud.weight[near].sum() < known.ambiguous_below:
            status = FixStatus.AMBIGUOUS
        share = cloud.weight[near] / cloud.weight[near].sum()
        xy, heading, covariance = moments(share, cloud.poses[near, :2], cloud.poses[near, 2])
        around = np.linalg.norm(self._map.xy_m - xy, axis=1)
        if heard:
            self._remember(float(scores[around <= known.near_m].max(initial=-1.0)))
        if suspect and self._settled < known.settled:
            return *NOWHERE, self._similarity, int(FixStatus.SUSPECT)
        if self._similarity < known.unknown_below and not suspect:
            return *NOWHERE, self._similarity, int(FixStatus.UNKNOWN_PLACE)
        if not heard:
            status = FixStatus.SUSPECT if suspect else FixStatus.NO_ECHO
        covariance += self._map.covariance_m2[int(np.argmin(around))]
        covariance += known.sigma_floor_m**2 * np.eye(2)
        return xy, heading, covariance, self._similarity, int(status)

    def _remember(self, similarity: float) -> None:
        past = similarity if np.isnan(self._similarity) else self._similarity
        self._similarity = (
            self._parameters.memory * past + (1 - self._parameters.memory) * similarity
        )


def densest(cloud: Cloud, near_m: float) -> F64:
    """The place (2) with the most weight around it: the heaviest cell, moved to its middle."""
    xy_m = cloud.poses[:, :2]
    _, member = np.unique(_cells(xy_m, near_m), axis=0, return_inverse=True)
    heaviest = np.argmax(np.bincount(member.ravel(), cloud.weight))
    inside = member.ravel() == heaviest
    for _ in range(2):
        weight = cloud.weight[inside]
        centre = weight @ xy_m[inside] / weight.sum()
        inside = np.linalg.norm(xy_m - centre, axis=1) <= near_m
    return np.asarray(centre)


def _reach_m(xy_m: F64, best_m: F64, near_m: float) -> float:
    """How far from the best place (2) particles (p, 2) may reach: twice as far as half of them."""
    return near_m / 2 + 2 * float(np.median(np.linalg.norm(xy_m - best_m, axis=1)))


def _cells(xy_m: F64, size_m: float) -> I64:
    return np.floor(xy_m / size_m).astype(np.int64)


def _strata(count: int, generator: np.random.Generator) -> F64:
    """Even shares (count) of [0, 1), all shifted by one draw."""
    return np.asarray((np.arange(count) + generator.uniform()) / max(count, 1))


def _half(move: F64) -> F64:
    return np.asarray(move / 2)


def _halfway(before: F64, after: F64) -> F64:
    """Poses (p, 3) in the middle of a step."""
    turn = wrap_angle(after[:, 2] - before[:, 2])
    xy_m = (before[:, :2] + after[:, :2]) / 2
    return np.column_stack([xy_m, before[:, 2] + turn / 2])
