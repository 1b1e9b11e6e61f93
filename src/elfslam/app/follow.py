"""Walks followed through floor plans: from a start on the plan, along what can be walked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.app.anchor import Plan
from elfslam.app.export import map_of
from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.geometry import compose
from elfslam.base.grid import FloorGrid
from elfslam.base.values import FloorMap, Run, Trajectory
from elfslam.data.atomic_files import new_folder, refuse_occupied, settled
from elfslam.data.facts import ENCODER, FACTS
from elfslam.data.geojson_files import walk_lines
from elfslam.data.map_files import MAP, write_map
from elfslam.data.runs import read_run
from elfslam.data.tum import write_tum
from elfslam.slam.parameters import Parameters
from elfslam.stages.floor_plan_alignment import (
    OK,
    AnchoringParameters,
    Placement,
    anchor,
    placed,
    standing,
)
from elfslam.stages.floormap import trajectory_map
from elfslam.stages.map_matching import (
    Followed,
    MapMatchingParameters,
    follow_ground,
    followed_trajectory,
)

FOLLOWED = "followed.tum"
SEED = 0


@dataclass(frozen=True, eq=False)
class Start:
    """Where a walk begins on a plan (x, y, heading), how certain that is (3, 3), and its scale."""

    pose: F64
    covariance: F64
    scale: float = 1.0


def start_on(placement: Placement, lines_m: list[F64], run: Run) -> Start:
    """Where a placed run begins on the plan, as uncertain as its placement."""
    first = run.trajectory.world_from_body[0]
    scaled = first * [placement.scale, placement.scale, 1.0]
    pose = compose(placement.plan_from_map, scaled)
    points = np.concatenate(lines_m)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    away = pose[:2] - placed(middle[None, :], placement.plan_from_map, placement.scale)[0]
    carried = np.eye(3)
    carried[:2, 2] = -away[1], away[0]
    return Start(pose, carried @ placement.covariance @ carried.T, placement.scale)


def follow(
    run: Run, start: Start, ground: FloorGrid, keep_off_m: float, parameters: MapMatchingParameters
) -> Followed:
    """The walk of a run through the passages of a plan; its covariance is of the plan's frame.

    Raises NoAnswerError where there is no ground, or the walk cannot keep to it.
    """
    open_ground = standing(ground, keep_off_m)
    if not open_ground.free.any():
        raise NoAnswerError(
            f"the plan has no ground {keep_off_m:g} m off its walls; lower anchoring.keep_off_m"
        )
    poses = run.trajectory.world_from_body * [start.scale, start.scale, 1.0]
    straightened = replace(run.odometry, world_from_body=poses)
    generator = np.random.default_rng(SEED)
    return follow_ground(
        straightened, start.pose, start.covariance, open_ground, parameters, generator
    )


def follow_into(
    out: Path,
    source: Path,
    plan: Plan,
    settings: tuple[AnchoringParameters, MapMatchingParameters],
    start: Start | None,
) -> Followed:
    """Bend a run through the passages of a plan, and write it as a map folder in its frame.

    From `start`, or from where `anchor` places it. Raises NoAnswerError where it cannot be placed
    or followed (nothing is written then), InputError where the source is no run.
    """
    anchoring, map_matching = settings
    refuse_occupied(out, None)
    if not (settled(source) / FACTS).is_file():
        raise InputError(f"{source}: is no run; only a walk with its footsteps can be followed")
    run = read_run(source)
    if start is None:
        lines = [line for _, line in walk_lines(map_of(source))]
        placement = anchor(lines, plan.ground, anchoring)
        if placement.status != OK:
            raise NoAnswerError(
                f"{source}: its place on the plan is {placement.status}; "
                "say with --start X,Y,HEADING where it begins"
            )
        start = start_on(placement, lines, run)
    followed = follow(run, start, plan.ground, anchoring.keep_off_m, map_matching)
    if followed.off_share > anchoring.most_off:
        raise NoAnswerError(
            f"{source}: {followed.off_share:.0%} of it leaves the ground of the plan whichever way "
            "it went; is it that floor, and is the start right?"
        )
    trajectory = followed_trajectory(run.trajectory, followed)
    with new_folder(out) as partial:
        write_map(_map_along(run, trajectory, map_of(source)), partial / MAP)
        write_tum(partial / FOLLOWED, trajectory.t_s, trajectory.world_from_body)
        if (source / ENCODER).is_file():
            (partial / ENCODER).write_bytes((source / ENCODER).read_bytes())
    return followed


def _map_along(run: Run, trajectory: Trajectory, known: FloorMap) -> FloorMap:
    """The map of a run, its spots where the followed walk passes them."""
    if run.features is None or run.floor_map is None:
        poses = trajectory.world_from_body
        covariance = trajectory.covariance[:, :2, :2]
        return replace(known, xy_m=poses[:, :2], heading_rad=poses[:, 2], covariance_m2=covariance)
    made = trajectory_map(
        trajectory,
        run.features,
        Parameters().floormap,
        parameters_digest=known.parameters_digest,
        source=run.name,
    )
    return replace(
        known,
        xy_m=made.xy_m,
        heading_rad=made.heading_rad,
        covariance_m2=made.covariance_m2,
    )
