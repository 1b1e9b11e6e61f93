"""Map matching: what the walls and furniture of a floor plan put right in a walk."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from elfslam.app.anchor import Start, follow
from elfslam.base.arrays import F64
from elfslam.base.geometry import between, compose, interpolate_poses
from elfslam.base.values import Run
from elfslam.scoring.errors import AS_DECLARED
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import Sense as Motion
from elfslam.slam.pipeline import map_by, map_by_echoes, no_similarity
from elfslam.stages.floor_plan_alignment import AnchoringParameters
from elfslam.stages.map_matching import MapMatchingParameters, followed_trajectory
from elfslam.world.kinds import PEOPLE, Kind
from elfslam.world.simulate import load_world
from studies.cached import SimulatedWalk, record_of, shipped, simulated
from studies.floor_plan import plan_of
from studies.mapping import trajectory_coverage
from studies.results import Record
from studies.study import Study, StudyContext, per_walk

WORLDS = ("living_room", "office", "mall")
SEEDS = (0, 1, 2, 3, 4)
ROUNDS = 2
START_SIGMA = np.array([0.5, 0.5, 0.2])
"""How well the walker says where the walk begins and whereto, m, m, rad."""
ECHOES, STEPS = "ELF", "dead reckoning"
GIVEN_START, MATCHED = "given start", "map matching"
MEDIAN = "median error (m)"


def measure_passages(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
    known: MapMatchingParameters | None = None,
) -> list[Record]:
    """Errors from the given start before and after (the condition), by echoes and by steps."""
    measure = partial(_measured, parameters=known or MapMatchingParameters())
    return per_walk(measure, context, worlds, seeds, rounds, kind)


def _measured(walk: SimulatedWalk, parameters: MapMatchingParameters) -> list[Record]:
    recording, truth = simulated(walk)
    ground = plan_of(load_world(walk.world).room, furnished=True)
    off = np.random.default_rng([walk.seed, 11]).normal(0, START_SIGMA)
    runs: dict[str, Run] = {
        STEPS: map_by(recording, [Motion(no_similarity, Parameters().closure)], Parameters()),
        ECHOES: map_by_echoes(recording, shipped(), Parameters()),
    }
    found: list[Record] = []
    for method, run in runs.items():
        poses = run.trajectory.world_from_body
        true = interpolate_poses(truth.t_s, truth.world_from_body, run.trajectory.t_s)
        start = Start(true[0] + off, np.diag(np.square(START_SIGMA)))
        before = compose(start.pose, between(poses[0], poses))
        after = follow(run, start, ground, AnchoringParameters().keep_off_m, parameters)
        covered = trajectory_coverage(
            followed_trajectory(run.trajectory, after), truth, AS_DECLARED
        )
        numbers = {
            MEDIAN: _median_m(after.poses, true),
            "within one sigma": covered.one_sigma,
            "within two sigma": covered.two_sigma,
            "off the ground": after.off_share,
        }
        found += record_of(walk, method, GIVEN_START).each({MEDIAN: _median_m(before, true)})
        found += record_of(walk, method, MATCHED).each(numbers)
    return found


def _median_m(poses: F64, true: F64) -> float:
    return float(np.median(np.linalg.norm(poses[:, :2] - true[:, :2], axis=1)))


STUDY = Study(
    "How much of a walk's error do walls and furniture of a floor plan put right?",
    measure_passages, minutes=30, scenarios=("people",), long=True,
    fast={"worlds": ("studio",), "seeds": (102,), "known": MapMatchingParameters(particles=1000)},
)  # fmt: skip
