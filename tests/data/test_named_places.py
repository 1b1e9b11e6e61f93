"""points_of_interest.csv: written and read back, and refused where it cannot be meant."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Checkpoints, PointKind, PointOfInterest
from elfslam.data import named_places


def refusal(read: Callable[[Path], object], folder: Path) -> str:
    with pytest.raises(InputError) as refused:
        read(folder)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_points_come_back_as_they_were(tmp_path: Path) -> None:
    told = (
        PointOfInterest('Room 5, "left"', PointKind.ROOM, -3.25, 0.125),
        PointOfInterest("Tür", PointKind.DOOR, 1e5, 2.0),
    )
    named_places.write_points(told, tmp_path)
    assert named_places.read_points(tmp_path) == told


def test_a_map_without_them_has_none(tmp_path: Path) -> None:
    assert named_places.read_points(tmp_path) == ()


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
        ("Door,door,1,2\n" * (named_places.MOST + 1), f"wanted at most {named_places.MOST}"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, row: str, said: str) -> None:
    (tmp_path / named_places.POINTS_OF_INTEREST).write_text(f"name,kind,x_m,y_m\n{row}\n")
    assert said in refusal(named_places.read_points, tmp_path)


def test_names_come_back_as_they_were(tmp_path: Path) -> None:
    told = Checkpoints(np.array([0.0, 12.345, 60.5]), ("Door", 'Room 5, "left"', "Tür"))
    named_places.write_checkpoints(told, tmp_path)
    read = named_places.read_checkpoints(tmp_path)
    assert read.names == told.names
    np.testing.assert_allclose(read.t_s, told.t_s)


def test_places_on_a_plan_come_back_and_others_stay_without(tmp_path: Path) -> None:
    xy_m = np.array([[3.25, -7.5], [np.nan, np.nan], [500_000.125, 5_000_000.25]])
    names = ("Door", "Stairs", "by UTM")
    named_places.write_checkpoints(Checkpoints(np.array([1.0, 2.0, 3.0]), names, xy_m), tmp_path)
    assert (tmp_path / named_places.CHECKPOINTS).read_text().splitlines()[2] == "2.000,Stairs,,"
    read = named_places.read_checkpoints(tmp_path)
    np.testing.assert_array_equal(read.xy_m, xy_m)


def test_they_are_on_no_plan_where_nobody_tapped(tmp_path: Path) -> None:
    (tmp_path / named_places.CHECKPOINTS).write_text("t_s,name,x_m,y_m\n1,Door,,\n")
    read = named_places.read_checkpoints(tmp_path)
    assert read.xy_m is None


def test_a_recording_without_them_has_none(tmp_path: Path) -> None:
    assert named_places.read_checkpoints(tmp_path) is None


def test_they_are_in_order_of_time_whoever_wrote_them(tmp_path: Path) -> None:
    (tmp_path / named_places.CHECKPOINTS).write_text("name,t_s\nb,9\na , 3\n")
    read = named_places.read_checkpoints(tmp_path)
    assert (read.names, read.t_s.tolist()) == (("a", "b"), [3.0, 9.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t_s\n3\n", "column name is missing"),
        ("t_s,name\nsoon,Door\n", "row 2 has time 'soon', wanted seconds"),
        ("t_s,name\ninf,Door\n", "row 2 has time 'inf'"),
        ("t_s,name\n1,Door\n2\n", "row 3 has a name of 0 characters"),
        (f"t_s,name\n1,{'x' * 81}\n", "row 2 has a name of 81 characters, wanted 1 to 80"),
        ("t_s,name\n1e9,Door\n", "1e+09"),
        ("t_s,name\n3,Door\n1,a\n3,b\n", "two checkpoints at 3.000 s"),
        (
            "t_s,name\n" + "1,Door\n" * (named_places.MOST + 1),
            f"wanted at most {named_places.MOST}",
        ),
        ("t_s,name,x_m,y_m\n1,Door,3,\n", "row 2 has x_m, y_m '3,', wanted metres for both"),
        ("t_s,name,x_m,y_m\n1,Door,3,nan\n", "wanted metres for both or for none"),
        ("t_s,name,x_m,y_m\n1,Door,3,1e9\n", "1e+09 m"),
        ("", "is empty"),
    ],
)
def test_checkpoints_that_cannot_be_meant_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / named_places.CHECKPOINTS).write_text(text)
    assert said in refusal(named_places.read_checkpoints, tmp_path)
