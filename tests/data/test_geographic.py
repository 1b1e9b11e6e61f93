"""Metres and degrees: known arcs of the Earth, and back to the millimetre."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import ParameterError
from elfslam.data.geographic import Origin, bearings_deg, from_lon_lat, parse_origin, to_lon_lat

ZURICH = Origin(47.3769, 8.5417, 90.0)


@pytest.mark.parametrize(
    "origin", [ZURICH, Origin(-33.9, 151.2, 17.0), Origin(70.0, 179.9999, 250)]
)
def test_a_kilometre_comes_back_to_a_millimetre(origin: Origin) -> None:
    xy_m = np.random.default_rng(0).uniform(-1000, 1000, (200, 2))
    npt.assert_allclose(from_lon_lat(origin, to_lon_lat(origin, xy_m)), xy_m, atol=1e-3)


def test_a_degree_is_as_long_as_wgs84_says() -> None:
    """A second of latitude at the equator is 30.715 m, of longitude 30.922 m."""
    degrees = to_lon_lat(Origin(0.0, 0.0), np.array([[30.922, 0.0], [0.0, 30.715]]))
    npt.assert_allclose(degrees * 3600, [[1.0, 0.0], [0.0, 1.0]], atol=1e-4)


def test_the_bearing_turns_the_x_axis() -> None:
    north = to_lon_lat(Origin(47.0, 8.0, 0.0), np.array([[100.0, 0.0], [0.0, 100.0]]))
    assert north[0, 1] > 47.0008 > north[1, 1]
    assert north[1, 0] < 7.9987, "left of north is west"
    npt.assert_allclose(bearings_deg(ZURICH, np.array([0.0, np.pi / 2, np.pi])), [90, 0, 270])


@pytest.mark.parametrize("text", ["", "47", "47,8,9,10", "north,8", "91,0", "0,181", "nan,0"])
def test_what_is_no_origin_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="origin"):
        parse_origin(text)


def test_an_origin_points_east_unless_told() -> None:
    assert parse_origin("47.3769,8.5417") == ZURICH
    assert parse_origin("47.3769, 8.5417, 12") == Origin(47.3769, 8.5417, 12.0)
