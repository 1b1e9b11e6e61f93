"""points_of_interest.csv: written and read back, and refused where it cannot be meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import PointKind, PointOfInterest
from elfslam.data.points_of_interest_files import (
    MOST,
    POINTS_OF_INTEREST,
    read_points,
    write_points,
)


def test_points_come_back_as_they_were(tmp_path: Path) -> None:
    told = (
        PointOfInterest('Room 5, "left"', PointKind.ROOM, -3.25, 0.125),
        PointOfInterest("Tür", PointKind.DOOR, 1e5, 2.0),
    )
    write_points(told, tmp_path)
    assert read_points(tmp_path) == told


def test_a_map_without_them_has_none(tmp_path: Path) -> None:
    assert read_points(tmp_path) == ()


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (",room,1,2", "row 2 has a name of 0 characters, wanted 1 to 80"),
        (f"{'x' * 81},room,1,2", "row 2 has a name of 81 characters"),
        ("Door,gate,1,2", "row 2 has kind 'gate', wanted room, door, stairs, lift, other"),
        ("Door,door,here,2", "row 2 has 'here', wanted metres"),
        ("Door,door,1,nan", "row 2 has 'nan', wanted metres"),
        ("Door,door,1,2e8", "row 2 has '2e8', wanted metres up to 1e+08"),
        ("Door,door,1", "row 2 has '', wanted metres"),
        ("Door,door,1,2\n" * (MOST + 1), f"wanted at most {MOST}"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, row: str, said: str) -> None:
    (tmp_path / POINTS_OF_INTEREST).write_text(f"name,kind,x_m,y_m\n{row}\n")
    with pytest.raises(InputError) as refusal:
        read_points(tmp_path)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
