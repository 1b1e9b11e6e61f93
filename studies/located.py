"""One person maps a place, another is located in the map: what several studies share."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.arrays import F32, F64
from elfslam.base.enums import Mode
from elfslam.base.geometry import compose, interpolate_poses, inverse
from elfslam.base.values import (
    Echoes,
    Features,
    Fixes,
    FixStatus,
    FloorMap,
    Odometry,
    Recording,
    Run,
    Trajectory,
    Truth,
)
from elfslam.scoring.errors import Alignment, fix_distances, match, placement, summarise
from elfslam.slam.front_end import dead_reckoning_nodes
from elfslam.slam.pipeline import footstep_similarity, locate_walk, map_by_echoes
from elfslam.stages.locate import locate_one_shot
from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import QUIET, Kind
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import World
from studies.cached import (
    at_its_start,
    extract_echoes,
    extract_features,
    shipped,
    simulate,
    simulated_in,
)
from studies.mapping import CALIBRATED, walkers

MAPPING_ROUNDS = 4
STRANGER = 1000
"""Added to a seed: the walk to be located is another person's."""
GROSS_M = 1.0
MEDIAN_M, OVER_1_M = "median error (m)", "over 1 m"
"""Metrics of fixes: of the answered ones, as the share of which the second is told."""


@dataclass(frozen=True, eq=False)
class Mapped:
    """A mapped walk, with the truth about it."""

    recording: Recording
    run: Run
    truth: Truth


@dataclass(frozen=True, eq=False)
class Stranger:
    """What is known of the walk to be located, and the truth about it."""

    recording: Recording
    nodes: Odometry
    echoes: Echoes
    features: Features
    truth: Truth


def mapped_walk(
    world: World,
    seed: int,
    rounds: int,
    *,
    sensors: Collection[Sensor] = (),
    kind: Kind = QUIET,
) -> Mapped:
    """A walk by someone whose steps are known, from a known start, mapped by echoes."""
    recording, truth = simulated_in(world, seed, rounds, kind, sensors=sensors)
    recording = at_its_start(recording, truth)
    run = map_by_echoes(recording, shipped(), walkers(seed, kind)[CALIBRATED])
    return Mapped(recording, run, truth)


def stranger(
    world: World,
    seed: int,
    rounds: int,
    *,
    sensors: Collection[Sensor] = (),
    circumstances: Circumstances | None = None,
    kind: Kind = QUIET,
    reverse: bool = False,
    on_mapped_way: bool = False,
) -> Stranger:
    """Another person's walk, of which neither start nor length of step is known.

    `circumstances` are those of the kind unless others are given; so is the way, unless it is to be
    the mapped one.
    """
    today = circumstances or kind.asking(world.room)
    there = world if on_mapped_way else kind.asking_place(world, seed + STRANGER)
    recording, truth = simulate(
        there, seed + STRANGER, rounds=rounds, sensors=sensors, walker=kind.walker,
        circumstances=today, reverse=reverse,
    )  # fmt: skip
    echoes = extract_echoes(recording, Settings())
    features = extract_features(echoes, shipped())
    return Stranger(recording, dead_reckoning_nodes(recording, Settings()), echoes, features, truth)


def located(mapped: Mapped, other: Stranger, mode: Mode, settings: Settings) -> Fixes:
    """Where the stranger is in the map, by echoes."""
    assert mapped.run.floor_map is not None
    return located_in(mapped.run.floor_map, other, mode, settings)


def located_in(floor_map: FloorMap, other: Stranger, mode: Mode, settings: Settings) -> Fixes:
    """Where the stranger is in any map, by echoes."""
    if mode is Mode.ONE_SHOT:
        return locate_one_shot(other.features, floor_map, settings.locate)
    scores: F32 = footstep_similarity(other.features, other.nodes, floor_map, settings.locate)
    return locate_walk(other.nodes, scores, floor_map, settings, mode=mode)


def fix_numbers(
    fixes: Fixes, other: Truth, trajectory: Trajectory, mapped: Truth
) -> dict[str, float]:
    """Errors of the answered fixes in metres, how many were answered, and whether sigma is honest.

    The map lies in the world by the best rigid fit of its own walk; anchored by its start
    alone, as the covariances have it (`NEES`, 2 where they are right). By metric, as records name
    them; empty lists give NaN.
    """
    status, errors = fix_distances(
        fixes, other, _map_in_world(trajectory, mapped, Alignment.ALIGNED)
    )
    answered = errors[status == FixStatus.OK]
    summary = summarise(answered)
    return {
        MEDIAN_M: summary.median_m,
        "mean error (m)": summary.mean_m,
        "third quartile (m)": summary.q3_m,
        "answered": float(np.mean(status == FixStatus.OK)),
        OVER_1_M: float(np.mean(answered > GROSS_M)) if len(answered) else float("nan"),
        "NEES": _nees(fixes, other, _map_in_world(trajectory, mapped, Alignment.ANCHORED)),
    }


def world_from_map(mapped: Mapped) -> F64:
    """Where the map (3) lies in the world, by the best rigid fit of its own walk."""
    return _map_in_world(mapped.run.trajectory, mapped.truth, Alignment.ALIGNED)


def _map_in_world(trajectory: Trajectory, truth: Truth, alignment: Alignment) -> F64:
    matched = match(trajectory.t_s, trajectory.world_from_body, truth)
    return placement(matched, alignment).world_from_map


def _nees(fixes: Fixes, truth: Truth, world_from_map: F64) -> float:
    """Mean normalised error squared in the plane of the answered fixes."""
    inside = (fixes.t_s >= truth.t_s[0]) & (fixes.t_s <= truth.t_s[-1])
    used = inside & (fixes.status == FixStatus.OK)
    if not used.any():
        return float("nan")
    true = interpolate_poses(truth.t_s, truth.world_from_body, fixes.t_s[used])
    error_m = fixes.xy_m[used] - compose(inverse(world_from_map), true)[:, :2]
    solved = np.linalg.solve(fixes.covariance_m2[used], error_m[:, :, None])[:, :, 0]
    return float(np.mean(np.sum(error_m * solved, axis=1)))
