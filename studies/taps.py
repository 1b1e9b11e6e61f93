"""What a place tapped on the floor plan is worth: a map's errors by how many were tapped."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Checkpoints, Trajectory, Truth
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.checkpoints import lies_on_plan
from elfslam.world.kinds import PEOPLE, Kind, kind_named
from studies.cached import SimulatedWalk, at_its_start, record_of, shipped, simulated
from studies.localization import SEEDS, WORLDS
from studies.located import MAPPING_ROUNDS
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import ELF
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, median_aligned_m, per_walk

TAPS = (0, 2, 4, 8)
"""Without any the walker declares where the walk begins."""
GOLDEN = 0.5 * (5**0.5 - 1)
"""Times at multiples of this share of a walk are at different places of its rounds."""
TAP_SIGMA_M = 0.3
IN_FRAME = "median error, in its frame (m)"
"""A map that its taps do not turn is on no plan, and has no error in its frame."""


def measure_taps(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = MAPPING_ROUNDS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Median errors of maps by taps: in the frame that they claim, and after a rigid fit."""
    return per_walk(_measured, context, worlds, seeds, rounds, kind)


def tapped(truth: Truth, taps: int, seed: int) -> Checkpoints:
    """Places tapped on the way, each a little beside where the walker is."""
    generator = np.random.default_rng([seed, 77])
    share = np.sort((0.5 + GOLDEN * np.arange(taps)) % 1.0)
    t_s = truth.t_s[0] + share * (truth.t_s[-1] - truth.t_s[0])
    xy_m = interpolate_poses(truth.t_s, truth.world_from_body, t_s)[:, :2]
    names = tuple(f"place {k}" for k in range(taps))
    return Checkpoints(t_s, names, xy_m + generator.normal(0, TAP_SIGMA_M, xy_m.shape))


def _measured(walk: SimulatedWalk) -> list[Record]:
    kind = kind_named(walk.kind)
    recording, truth = simulated(walk)
    settings = walkers(walk.seed, kind)[CALIBRATED]
    records: list[Record] = []
    for taps in TAPS:
        told = tapped(truth, taps, walk.seed) if taps else None
        begun = at_its_start(recording, truth) if told is None else recording
        run = map_by_echoes(replace(begun, checkpoints=told), shipped(), settings)
        on_plan = told is None or lies_on_plan(told, run.trajectory, settings.checkpoint)
        numbers = {
            IN_FRAME: _in_frame_m(run.trajectory, truth) if on_plan else float("nan"),
            MEDIAN_ALIGNED: median_aligned_m(run.trajectory, truth),
        }
        records += record_of(walk, ELF, f"{taps} taps").each(numbers)
    return records


def _in_frame_m(mapped: Trajectory, truth: Truth) -> float:
    """The median error as the map lies."""
    true = interpolate_poses(truth.t_s, truth.world_from_body, mapped.t_s)
    return float(np.median(np.linalg.norm((mapped.world_from_body - true)[:, :2], axis=1)))


STUDY = Study(
    "What is a place tapped on the floor plan worth to a map?",
    measure_taps, minutes=10, long=True,
    fast={"worlds": ("studio",), "seeds": (100,), "rounds": 2},
)  # fmt: skip
