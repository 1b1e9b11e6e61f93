"""Scores of many walks at once."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.app.score_many import score_walks
from elfslam.base.errors import InputError
from elfslam.base.values import Closures, Odometry, Recording, Run, Similarity, Trajectory, Truth
from elfslam.data.recordings import write_recording
from elfslam.data.runs import write_run

POSES = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])
TIMES = np.arange(11.0)


def straight_run(name: str, scale: float, status: str) -> Run:
    """Ten metres walked straight ahead, measured `scale` times as long."""
    nodes = Odometry(TIMES, POSES * [scale, 1, 1], np.full((10, 3), 0.1))
    none = Closures([], [], [], np.zeros((0, 3)), np.zeros((0, 3, 3)))
    trajectory = Trajectory(TIMES, POSES, np.tile(np.eye(3), (11, 1, 1)), [], status)
    similarity = Similarity(np.zeros((10, 10)), "motion")
    return Run(name, nodes, similarity, none, trajectory, None, None, None)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    waypoints = Truth([0.0, 5.0, 10.0], [[0, 0, np.nan], [5, 0, np.nan], [10, 0, np.nan]])
    two = Truth([0.0, 10.0], [[0, 0, np.nan], [10, 0, np.nan]])
    for name, scale, truth in (("a", 1.1, waypoints), ("b", 1.3, waypoints), ("c", 2.0, two)):
        run = straight_run(name, scale, "OK" if name == "a" else "NO_CLOSURES")
        write_run(run, tmp_path / "runs" / name, facts={}, encoder=None)
        write_recording(Recording(name, "phone"), tmp_path / "walks" / name, truth=truth)
    return tmp_path / "runs", tmp_path / "walks"


def test_medians_over_walks_with_enough_waypoints(folders: tuple[Path, Path]) -> None:
    rows, left_out = score_walks(*folders)
    assert list(left_out) == ["c"]
    assert "2 positions, wanted 3" in left_out["c"]
    table = {(row["method"], row["measure"]): row for row in rows}
    reckoned = table["dead reckoning", "length_ratio"]
    assert (reckoned["walks"], reckoned["scored"]) == (3, 2)
    assert (reckoned["low_95"], reckoned["high_95"]) == pytest.approx((1.1, 1.3))
    assert reckoned["median"] == pytest.approx(1.2)
    assert table["dead reckoning", "end_error_percent"]["median"] == pytest.approx(20.0)
    assert table["dead reckoning", "scaled_rmse_m"]["median"] == pytest.approx(0.0, abs=1e-6)
    assert table["SLAM", "aligned_rmse_m"]["scored"] == 1
    assert table["SLAM", "aligned_rmse_m"]["median"] == pytest.approx(0.0, abs=1e-6)


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no run"):
        score_walks(tmp_path, tmp_path)


def test_a_walk_without_truth_or_a_damaged_run_costs_no_other(folders: tuple[Path, Path]) -> None:
    runs, walks = folders
    (walks / "a" / "waypoints.csv").unlink()
    (runs / "c" / "odometry.tum").unlink()
    rows, left_out = score_walks(runs, walks)
    assert {row["scored"] for row in rows} == {1}
    assert {row["walks"] for row in rows} == {3}
    assert "no truth" in left_out["a"]
    assert set(left_out) == {"a", "c"}


def test_no_walk_with_truth_is_refused_with_a_reason(folders: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match=r"none of 3 runs can be scored; a: .*nowhere"):
        score_walks(folders[0], folders[1] / "nowhere")
