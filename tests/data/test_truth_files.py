"""The truth on disk."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Imu, Truth
from elfslam.data.truth_files import pauses_s, read_marks, stood_on, write_truth
from elfslam.scoring.truth import read_truth


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


RATE_HZ = 100
CADENCE_HZ = 1.9
SPANS_S = [(0.0, 5.0), (15.0, 18.0), (26.0, 29.0), (41.0, 46.0)]
"""When the walker stands still; between, a footstep every 0.53 s."""
MARKS = {"M1": (1.0, 2.0), "M2": (9.5, 2.0), "M3": (9.5, -7.25)}


def walk(spans_s: list[tuple[float, float]] = SPANS_S) -> Imu:
    generator = np.random.default_rng(3)
    t_s = np.arange(round(spans_s[-1][1] * RATE_HZ)) / RATE_HZ
    walking = np.ones(len(t_s))
    for first, last in spans_s:
        walking[(t_s >= first) & (t_s < last)] = 0.0
    accel = np.column_stack([np.zeros((len(t_s), 2)), np.full(len(t_s), 9.81)])
    accel[:, 2] += 3.0 * walking * np.sin(2 * np.pi * CADENCE_HZ * t_s)
    accel += 0.03 * generator.standard_normal(accel.shape)
    return Imu(t_s, accel, 0.01 * generator.standard_normal(accel.shape))


def test_the_pauses_are_where_they_were_planted() -> None:
    found = pauses_s(walk())
    assert found.shape == (4, 2)
    np.testing.assert_allclose(found, SPANS_S, atol=0.6)


def test_marks_become_waypoints_in_the_order_given() -> None:
    truth = stood_on(walk(), MARKS, ["M1", "M2", "M3", "M1"])
    np.testing.assert_allclose(truth.t_s, np.mean(SPANS_S, axis=1), atol=0.6)
    wanted = [MARKS["M1"], MARKS["M2"], MARKS["M3"], MARKS["M1"]]
    np.testing.assert_array_equal(truth.world_from_body[:, :2], wanted)
    assert np.isnan(truth.world_from_body[:, 2]).all()


@pytest.mark.parametrize(
    ("visited", "says"),
    [
        (["M1", "M2", "M3"], r"stood still 4 times \(at 0-5, 1\d-18, 2\d-29, 4\d-46 s\), wanted 3"),
        (["M1", "M2", "M3", "M1", "M2"], "wanted 5"),
        (["M1", "M2", "M4", "M1"], "'M4' is not among M1, M2, M3"),
        ([], "wanted 0"),
    ],
)
def test_a_list_that_does_not_fit_is_refused(visited: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        stood_on(walk(), MARKS, visited)


def test_marks_are_read(tmp_path: Path) -> None:
    (tmp_path / "marks.csv").write_text("name, x_m, y_m\nM1,1,2\nM2,9.5,2\n M3 ,9.5,-7.25\n")
    assert read_marks(tmp_path / "marks.csv") == MARKS


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x_m,y_m\n1,2\n", "wanted name,x_m,y_m"),
        ("name,x_m,y_m\n", "has no marks"),
        ("name,x_m,y_m\nM1,1,2\nM1,3,4\n", "has 'M1' twice"),
        ("name,x_m,y_m\nM1,1,2\nM2,3\n", "row 3 has 2 cells"),
        ("name,x_m,y_m\nM1,1,nan\n", "row 2 has 'nan'"),
        ("", "is empty"),
    ],
)
def test_marks_that_cannot_be_read_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "marks.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_marks(tmp_path / "marks.csv")
