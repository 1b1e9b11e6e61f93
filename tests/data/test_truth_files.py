"""The truth on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Truth
from elfslam.data.truth_files import write_truth
from elfslam.scoring.truth import read_truth


def test_poses_round_trip(tmp_path: Path, truth: Truth) -> None:
    write_truth(truth, tmp_path)
    for path in (tmp_path, tmp_path / "truth.tum"):
        np.testing.assert_allclose(
            read_truth(path).world_from_body, truth.world_from_body, atol=4e-9
        )


def test_waypoints_round_trip(tmp_path: Path) -> None:
    truth = Truth([0.5, 2.0], [[1.0, 2.0, np.nan], [3.0, 4.0, np.nan]])
    write_truth(truth, tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["waypoints.csv"]
    assert (tmp_path / "waypoints.csv").read_text().splitlines()[1] == "0.500000,1,2"
    read = read_truth(tmp_path)
    np.testing.assert_array_equal(read.world_from_body, truth.world_from_body)
    np.testing.assert_array_equal(read.t_s, truth.t_s)


def test_an_empty_truth_writes_nothing(tmp_path: Path) -> None:
    write_truth(Truth(np.empty(0), np.empty((0, 3))), tmp_path)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="no truth in this recording"):
        read_truth(tmp_path)
