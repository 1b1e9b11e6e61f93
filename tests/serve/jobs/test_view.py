"""What the viewer draws lies where the map says, and is little enough."""

import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import StoreError
from elfslam.base.values import Closures, Odometry, Recording, Run, Trajectory
from elfslam.data.map_files import read_map
from elfslam.data.position_files import read_tum
from elfslam.data.runs import write_run
from elfslam.serve.maps.view import MOST_CLOSURES, Json, view_of
from elfslam.slam.pipeline import no_similarity

TWO_HOURS = 14_400
"""Footsteps."""


def test_a_run_is_drawn_where_it_was(runs: Path) -> None:
    view = view_of(runs / "one")
    t_s, poses = read_tum(runs / "one" / "trajectory.tum")
    [walk], [reckoned] = view["walks"], view["dead_reckoning"]
    npt.assert_allclose(walk["xy_m"], poses[:, :2], atol=1e-3)
    npt.assert_allclose(walk["t_s"], t_s, atol=1e-2)
    npt.assert_allclose(
        reckoned["xy_m"], read_tum(runs / "one" / "odometry.tum")[1][:, :2], atol=1e-3
    )
    assert view["bounds_m"] == pytest.approx([*poses[:, :2].min(0), *poses[:, :2].max(0)], abs=1e-3)
    assert walk["sigma_m"][0] < 0.01 < walk["sigma_m"][10]
    ends = np.array(view["closures"])
    assert len(ends)
    gaps_m = np.linalg.norm(ends[:, :2] - ends[:, 2:], axis=1)
    assert gaps_m.max() < 3.0


def test_coverage_counts_squares_where_people_were(runs: Path) -> None:
    view = view_of(runs / "floor")
    spots = read_map(runs / "floor").xy_m
    coverage = view["coverage"]
    corner, cell_m = np.array(coverage["corner_m"]), coverage["cell_m"]
    walks = np.array(coverage["walks"])
    assert list(walks.shape) == coverage["shape"]
    column, row = np.floor((spots - corner) / cell_m).astype(int).T
    seen = np.zeros(walks.shape, dtype=bool)
    seen[row, column] = True
    npt.assert_array_equal(walks > 0, seen)
    npt.assert_array_equal(
        [[one is not None for one in line] for line in coverage["sigma_m"]], seen
    )
    assert walks.max() == 2


def test_a_merged_map_draws_every_walk(runs: Path, tmp_path: Path) -> None:
    view = view_of(runs / "floor")
    assert [walk["name"] for walk in view["walks"]] == ["one", "two"]
    for walk in view["walks"]:
        assert len(walk["t_s"]) == len(walk["xy_m"]) == len(walk["sigma_m"]) > 40
    (runs / "floor" / "trajectories" / "two.tum").rename(tmp_path / "two.tum")
    lost = view_of(runs / "floor")
    (tmp_path / "two.tum").rename(runs / "floor" / "trajectories" / "two.tum")
    assert {walk["name"] for walk in lost["walks"]} == {"one", "two"}
    assert [walk["t_s"] for walk in lost["walks"] if walk["name"] == "two"] == [[]]


def test_two_hours_stay_below_two_megabytes(tmp_path: Path) -> None:
    write_run(long_run(), tmp_path / "long", facts={}, encoder=None)
    view: Json = view_of(tmp_path / "long")
    assert len(view["walks"][0]["xy_m"]) == TWO_HOURS
    assert len(view["closures"]) == MOST_CLOSURES
    assert len(json.dumps(view, allow_nan=False)) < 2_000_000


def test_a_damaged_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{")
    with pytest.raises(StoreError, match="damaged"):
        view_of(tmp_path)


def long_run() -> Run:
    """A walk of two hours in a place of a square kilometre, with very many closures."""
    generator = np.random.default_rng(0)
    t_s = np.arange(TWO_HOURS) * 0.5 + 0.123456
    poses = np.column_stack(
        [generator.uniform(-500, 500, (TWO_HOURS, 2)), generator.uniform(-3, 3, TWO_HOURS)]
    )
    sigma = np.full((TWO_HOURS - 1, 3), 0.1)
    odometry = Odometry(t_s, poses, sigma)
    i = np.sort(generator.integers(0, TWO_HOURS // 2, 20_000))
    j = i + TWO_HOURS // 2 - 1
    score = np.ones(len(i))
    spread = np.tile(np.eye(3) * 0.7, (len(i), 1, 1))
    closures = Closures(i, j, score, np.zeros((len(i), 3)), spread)
    covariance = np.tile(np.eye(3) * 123.456, (TWO_HOURS, 1, 1))
    trajectory = Trajectory(t_s, poses, covariance, score, "OK")
    similarity = no_similarity(Recording("long", "none"), odometry)
    return Run("long", odometry, similarity, closures, trajectory, None, None, None)
