"""Fixes as CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Fixes, FixStatus
from elfslam.data.fixes_files import read_fixes, write_fixes


def fixes() -> Fixes:
    nan = np.nan
    covariance = np.array([np.diag([0.04, 0.14]), np.full((2, 2), nan)])
    status = [FixStatus.OK, FixStatus.UNKNOWN_PLACE]
    return Fixes([0.3, 0.9], [[1.5, -2], [nan, nan]], [0.5, nan], covariance, [0.8, 0.1], status)


def test_cells_are_empty_where_there_is_no_position(tmp_path: Path) -> None:
    write_fixes(fixes(), tmp_path / "fixes.csv")
    assert (tmp_path / "fixes.csv").read_text().splitlines() == [
        "t_s,x_m,y_m,heading_rad,sigma_m,status",
        "0.300000,1.500000,-2.000000,0.500000,0.300000,OK",
        "0.900000,,,,,UNKNOWN_PLACE",
    ]


def test_round_trip(tmp_path: Path) -> None:
    write_fixes(fixes(), tmp_path / "fixes.csv")
    read = read_fixes(tmp_path / "fixes.csv")
    for name in ("t_s", "xy_m", "heading_rad", "status"):
        np.testing.assert_array_equal(getattr(read, name), getattr(fixes(), name))
    np.testing.assert_allclose(read.covariance_m2[0], 0.09 * np.eye(2))
    assert np.isnan(read.covariance_m2[1].diagonal()).all()


def test_a_position_may_lack_its_heading_and_not_the_other_way_round(tmp_path: Path) -> None:
    unheaded = Fixes([1.0], [[2.0, 3.0]], [np.nan], [0.04 * np.eye(2)], [1.0], [0])
    write_fixes(unheaded, tmp_path / "fixes.csv")
    read = read_fixes(tmp_path / "fixes.csv")
    np.testing.assert_array_equal(read.xy_m, unheaded.xy_m)
    assert np.isnan(read.heading_rad).all()


def test_no_fixes_round_trip(tmp_path: Path) -> None:
    none = Fixes([], np.empty((0, 2)), [], np.empty((0, 2, 2)), [], [])
    write_fixes(none, tmp_path / "fixes.csv")
    assert len(read_fixes(tmp_path / "fixes.csv").t_s) == 0


HEADER = "t_s,x_m,y_m,heading_rad,sigma_m,status\n"
DAMAGES = {
    "t_s,x_m,y_m\n": "column heading_rad is missing",
    HEADER + "0,1,2,0,0.1,GOOD\n": "row 2 is no fix",
    HEADER + "0,1,2,0,0.1\n": "row 2 is no fix",
    HEADER + "0,one,2,0,0.1,OK\n": "row 2 is no fix",
    HEADER + "0,,,,,OK\n": "row 2 lacks its time or position",
    HEADER + ",1,2,0,0.1,OK\n": "row 2 lacks its time or position",
    HEADER + "0,,,0,,UNKNOWN_PLACE\n": "row 2 lacks its time or position",
    HEADER + "0,1,,0,0.1,OK\n": "row 2 lacks its time or position",
    HEADER + "0,1,,0,0.1,AMBIGUOUS\n": "row 2 lacks its time or position",
    HEADER + "0,1,inf,0,0.1,OK\n": "row 2 lacks its time or position",
    HEADER + "0,inf,inf,inf,inf,NO_ECHO\n": "row 2 lacks .* or is beyond belief",
    HEADER + "0,1,2,0,1e200,OK\n": "row 2 lacks .* or is beyond belief",
    HEADER + "inf,1,2,0,0.1,OK\n": "row 2 lacks its time or position",
    HEADER + "1,1,2,0,0.1,OK\n0,1,2,0,0.1,OK\n": "runs backward at row 3",
}


@pytest.mark.parametrize("text", DAMAGES)
def test_damaged_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "fixes.csv").write_text(text)
    with pytest.raises(InputError, match=DAMAGES[text]):
        read_fixes(tmp_path / "fixes.csv")
