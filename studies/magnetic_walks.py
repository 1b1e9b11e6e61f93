"""The magnetic walks of Kok and Solin 2024: loops closed by the field alone, on a real phone."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Odometry, Orientation, Recording, Truth
from elfslam.baselines.magnetic import (
    MAGNETIC_CLOSURES,
    MagneticParameters,
    field_profile,
    magnetic_similarity,
)
from elfslam.data.magnetic import CAMERA_FROM_DEVICE, OdometryError, read_magnetic
from elfslam.line.closure import find_closures
from elfslam.line.graph import GraphParameters, build_graph, optimise
from elfslam.line.motion import nodes_by_distance
from elfslam.scoring.alignment import Alignment, match, place, placement
from elfslam.scoring.errors import position_errors
from elfslam.scoring.figures import DEAD_RECKONING, SLAM, TRUTH, plan, walk_traces
from elfslam.scoring.page import Page, Panel, rows_table
from studies.finding import Finding, Given, Row
from studies.magnetic_offsets import AlignmentParameters, align_closures

AS_STATED = GraphParameters(noise_rounds=0)
"""How noisy the odometry is, is known exactly: this study drifts it."""
SETS = ("library", "square", "eight")
SEEDS = (0, 1, 2, 3, 4)
"""Drifts that are reported; parameters were chosen on seeds from 101 on."""
PAPERS_DRIFT = OdometryError(
    heading_bias_radps=0.005, heading_sigma_rad=0.001, position_sigma_m=0.01, scale_sigma=0.0
)
"""Per sample of 0.1 s: 0.01 rad/s of noise turn by 0.001 rad."""
BIAS_SIGMA_RAD = 0.005
"""Of the turn in one sample: noise that gathers over a loop what a constant bias does."""
NODE_SPACING_M = 0.5
CLOSURES = replace(
    MAGNETIC_CLOSURES, threshold=0.45, along_sigma_m=1.5, across_sigma_m=1.5, heading_sigma_rad=0.3
)
"""This odometry is exact to a centimetre a sample, and closures along a line share most of their
field and so their error: each is trusted far less than it is exact."""
PAPER_RMSE_M = {"library": 0.30, "square": 0.10, "eight": 0.10}
PAPER_S = {"library": 138.0, "square": 66.0, "eight": 10.0}
"""Their program on the same input: median error over drifts, and its time."""
NOTE = (
    "Drifted odometry and map lie on the truth by the rigid move that fits best. The truth is the "
    "phone's own visual odometry, whose jumps (up to 0.8 m in library) no map can follow."
)
ROWS_NOTE = (
    "Root mean square errors after the rigid move, medians and ranges over five drifts. Levelled "
    "by: the phone's true roll and pitch; none: as if the phone were always held upright; or "
    "nothing but the field's strength. One set of parameters for all."
)


@dataclass(frozen=True, eq=False)
class Mapped:
    """A drifted walk and what the field makes of it."""

    truth: Truth
    odometry: Odometry
    nodes_t_s: F64
    poses: F64
    seconds: float


def measure_magnetic_walks(
    given: Given, *, sets: tuple[str, ...] = SETS, seeds: tuple[int, ...] = SEEDS
) -> Finding:
    """A row per set and way of levelling: errors of drifted odometry and of the map.

    `data` holds `magnetic/*.mat`. Raises InputError where they are missing.
    """
    if given.data is None:
        raise InputError("magnetic walks: wanted real walks; set ELFSLAM_DATA to their folder")
    rows: list[Row] = []
    panels: list[Panel] = []
    for k, name in enumerate(sets):
        given.announce(name, k / len(sets))
        walks = [
            read_magnetic(
                given.data / "magnetic" / f"{name}.mat", np.random.default_rng(seed), PAPERS_DRIFT
            )
            for seed in seeds
        ]
        for levelled, orientation_of in LEVELLINGS.items():
            mapped = [map_by_field(*walk, orientation_of(walk[0])) for walk in walks]
            rows.append(_row(name, levelled, mapped))
            if levelled == next(iter(LEVELLINGS)):
                panels.append(_panel(name, mapped))
    table = Panel("Errors", rows_table(rows), ROWS_NOTE, wide=True)
    return Finding(rows, Page("Loops closed by the magnetic field", NOTE, [table, *panels]))


def map_by_field(recording: Recording, truth: Truth, orientation: Orientation | None) -> Mapped:
    """The drifted walk straightened by closures of its field; the truth is carried along only."""
    odometry, magnetometer = recording.odometry, recording.magnetometer
    assert odometry is not None
    assert magnetometer is not None
    begun = time.perf_counter()
    nodes = nodes_by_distance(honest(odometry), NODE_SPACING_M)
    parameters, finer = MagneticParameters(), AlignmentParameters()
    similarity = magnetic_similarity(magnetometer, orientation, nodes, parameters)
    closures = find_closures(similarity, nodes, CLOSURES)
    fine = replace(parameters, spacing_m=finer.step_m)
    profile = field_profile(magnetometer, orientation, nodes, fine)
    closures = align_closures(closures, nodes, profile, finer)
    trajectory = optimise(build_graph(nodes, closures), nodes.t_s, AS_STATED)
    seconds = time.perf_counter() - begun
    return Mapped(truth, odometry, nodes.t_s, trajectory.world_from_body, seconds)


def held_upright(recording: Recording) -> Orientation:
    """One attitude for the whole walk, camera level: what is known without roll and pitch."""
    assert recording.odometry is not None
    world_from_camera = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    attitude = Rotation.from_matrix(world_from_camera) * Rotation.from_quat(CAMERA_FROM_DEVICE)
    return Orientation(recording.odometry.t_s[[0, -1]], np.tile(attitude.as_quat(), (2, 1)))


LEVELLINGS: dict[str, Callable[[Recording], Orientation | None]] = {
    "roll and pitch": lambda recording: recording.orientation,
    "none": held_upright,
    "strength only": lambda recording: None,
}


def honest(odometry: Odometry) -> Odometry:
    """With turns trusted as little as their constant bias deserves."""
    sigma = np.array(odometry.step_sigma)
    sigma[:, 2] = np.hypot(PAPERS_DRIFT.heading_sigma_rad, BIAS_SIGMA_RAD)
    return replace(odometry, step_sigma=sigma)


def rmse_m(t_s: F64, poses: F64, truth: Truth) -> float:
    """Root mean square error of poses (n, 3) after the rigid move that fits best."""
    errors = position_errors(t_s, poses, truth, Alignment.ALIGNED)
    return float(np.sqrt(np.mean(errors**2)))


def _row(name: str, levelled: str, mapped: list[Mapped]) -> Row:
    drifted = [rmse_m(m.odometry.t_s, m.odometry.world_from_body, m.truth) for m in mapped]
    errors = [rmse_m(m.nodes_t_s, m.poses, m.truth) for m in mapped]
    return {
        "set": name,
        "levelled by": levelled,
        "drifted (m)": round(float(np.median(drifted)), 3),
        "drifted, range": f"{min(drifted):.2f} to {max(drifted):.2f}",
        "mapped (m)": round(float(np.median(errors)), 3),
        "mapped, range": f"{min(errors):.2f} to {max(errors):.2f}",
        "their program (m)": PAPER_RMSE_M[name],
        "seconds": round(float(np.median([m.seconds for m in mapped])), 2),
        "their seconds": PAPER_S[name],
    }


def _panel(name: str, mapped: list[Mapped]) -> Panel:
    """The walk whose map has the median error."""
    order = np.argsort([rmse_m(m.nodes_t_s, m.poses, m.truth) for m in mapped])
    shown = mapped[order[len(order) // 2]]
    true = shown.truth.world_from_body
    drifted = _laid_on(shown.odometry.t_s, shown.odometry.world_from_body, shown.truth)
    walks = [
        *walk_traces(drifted, "drifted", DEAD_RECKONING, width=1.5, opacity=0.7),
        *walk_traces(true[:, :2], "truth", TRUTH, dash="dot"),
        *walk_traces(_laid_on(shown.nodes_t_s, shown.poses, shown.truth), "mapped", SLAM),
    ]
    return Panel(name, plan(walks, height_px=460))


def _laid_on(t_s: F64, poses: F64, truth: Truth) -> F64:
    where = placement(match(t_s, poses, truth), Alignment.ALIGNED)
    return np.asarray(place(poses, where)[:, :2])
