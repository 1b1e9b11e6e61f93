"""What is told of positions: ages become times, places become latitudes, halves are refused."""

from datetime import UTC, datetime
from typing import Any, get_args

import pytest
from pydantic import ValidationError

from elfslam.base.values import FixStatus
from elfslam.serve.positions.values import (
    LivePosition,
    MapOrigin,
    NewPosition,
    NewPositions,
    Status,
    told_of,
)

NOW = datetime(2026, 3, 1, 12, 0, 10, tzinfo=UTC)
EQUATOR_DEG_PER_M = 180 / 3.141592653589793 / 6_378_137.0


def given(*positions: dict[str, Any]) -> NewPositions:
    return NewPositions(
        map="a" * 32, walk="b" * 16, positions=[NewPosition(**p) for p in positions]
    )


def told(*positions: dict[str, Any], origin: MapOrigin | None = None) -> list[LivePosition]:
    return told_of(given(*positions), "w", "Ada", NOW, origin)


def test_every_status_of_a_fix_is_taken() -> None:
    assert get_args(Status) == tuple(status.name for status in FixStatus)


def test_ages_become_times_and_the_oldest_comes_first() -> None:
    found = told({"status": "OK", "age_s": 0.5}, {"status": "NO_ECHO", "age_s": 2})
    assert [each.time_utc.isoformat() for each in found] == [
        "2026-03-01T12:00:08+00:00", "2026-03-01T12:00:09.500000+00:00",
    ]  # fmt: skip
    assert [each.status for each in found] == ["NO_ECHO", "OK"]
    assert (found[0].walker, found[0].name, found[0].map) == ("w", "Ada", "a" * 32)


def test_numbers_are_told_no_finer_than_they_are_worth() -> None:
    [found] = told({"status": "OK", "x_m": 1.23456, "y_m": -2, "heading_rad": 0.12345678})
    assert (found.x_m, found.y_m, found.heading_rad) == (1.235, -2.0, 0.1235)
    assert found.sigma_m is None


def test_a_place_has_a_latitude_only_where_the_map_is_placed() -> None:
    here = {"status": "OK", "x_m": 100.0, "y_m": 0.0}
    assert told(here)[0].latitude_deg is None
    east = MapOrigin(latitude_deg=0, longitude_deg=10)
    [found] = told(here, origin=east)
    assert found.latitude_deg == pytest.approx(0, abs=1e-9)
    assert found.longitude_deg == pytest.approx(10 + 100 * EQUATOR_DEG_PER_M, abs=1e-8)
    north = MapOrigin(latitude_deg=0, longitude_deg=10, bearing_deg=0)
    [turned] = told(here, origin=north)
    assert turned.longitude_deg == pytest.approx(10, abs=1e-9)
    assert turned.latitude_deg == pytest.approx(9.04e-4, abs=1e-6)


def test_who_is_nowhere_has_no_latitude() -> None:
    origin = MapOrigin(latitude_deg=47, longitude_deg=8)
    found = told({"status": "UNKNOWN_PLACE"}, {"status": "OK", "x_m": 0, "y_m": 0}, origin=origin)
    assert [(each.latitude_deg, each.longitude_deg) for each in found] == [
        (None, None),
        (47.0, 8.0),
    ]


@pytest.mark.parametrize(
    "wrong",
    [
        {"x_m": 1.0},
        {"y_m": 1.0},
        {"x_m": float("nan"), "y_m": 0},
        {"x_m": 1e9, "y_m": 0},
        {"age_s": 61},
        {"age_s": -0.1},
        {"sigma_m": -1},
        {"heading_rad": float("inf")},
        {"status": "FINE"},
    ],
)
def test_what_is_no_position_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        NewPosition(**{"status": "OK", **wrong})
