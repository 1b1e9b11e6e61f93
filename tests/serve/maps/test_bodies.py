"""How high a floor lies, by what people call it."""

from __future__ import annotations

import pytest

from elfslam.serve.maps.bodies import floor_name, level_of


@pytest.mark.parametrize(
    ("name", "level"),
    [
        ("Ground floor", 0), ("ground", 0), ("Lobby", 0), ("EG", 0), ("0", 0),
        ("Floor 2", 2), ("2nd floor", 2), ("12", 12), ("Level 3, east", 3), ("Hall-2", 2),
        ("-1", -1), ("\u22122", -2), ("Level -3", -3), ("Basement", -1), ("Basement 2", -2),
        ("B1", -1), ("UG2", -2), ("Underground 3", -3), ("Building 7, ground floor", 0),
        ("Mezzanine", None), ("Room 1024", None), ("Aground", None), (None, None),
    ],
)  # fmt: skip
def test_a_name_says_how_high_a_floor_lies(name: str | None, level: int | None) -> None:
    assert level_of(name) == level


def test_floors_of_published_buildings_lie_where_they_say() -> None:
    for level in (-3, -1, 0, 1, 42):
        assert level_of(floor_name(level)) == level
