"""Where a map lies on the Earth: metres on a plane that touches it, and WGS84 degrees.

The plane is the local tangent plane at the origin (east, north, up; up is dropped). Ellipsoid:
NIMA TR8350.2, "World Geodetic System 1984".
"""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import ParameterError

MAJOR_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
ROUNDS = 6
"""Of the latitude's iteration: far below a nanometre."""
EAST_DEG = 90.0
HIGHEST_DEG = 89.0


@dataclass(frozen=True)
class Origin:
    """Where a map's origin lies, and where its x axis points, clockwise from north."""

    latitude_deg: float
    longitude_deg: float
    bearing_deg: float = EAST_DEG


def parse_origin(text: str) -> Origin:
    """The origin of "LAT,LON" or "LAT,LON,BEARING" in degrees. Raises ParameterError."""
    cells = text.split(",")
    try:
        numbers = [float(cell) for cell in cells]
        good = len(numbers) in (2, 3) and bool(np.isfinite(numbers).all())
        good = good and abs(numbers[0]) <= HIGHEST_DEG and abs(numbers[1]) <= 180
    except ValueError:
        good = False
    if not good:
        raise ParameterError(
            f"origin {text!r}: wanted LAT,LON[,BEARING_DEG], latitude within "
            f"{HIGHEST_DEG:g} and longitude within 180 degrees; such as 47.3769,8.5417,90",
            argument="origin",
        )
    return Origin(*numbers)


def to_lon_lat(origin: Origin, xy_m: F64) -> F64:
    """Longitudes and latitudes (n, 2) in degrees of points (n, 2) of the map."""
    bearing = np.deg2rad(origin.bearing_deg)
    along = np.array([np.sin(bearing), np.cos(bearing)])
    left = np.array([-along[1], along[0]])
    east_north = xy_m[:, :1] * along + xy_m[:, 1:] * left
    axes = _axes(origin)
    place = _centred(_lon_lat(origin)) + east_north @ axes[:2]
    return _geodetic(np.asarray(place))


def from_lon_lat(origin: Origin, lon_lat_deg: F64) -> F64:
    """Points (n, 2) of the map at longitudes and latitudes (n, 2) in degrees."""
    bearing = np.deg2rad(origin.bearing_deg)
    moved = _centred(lon_lat_deg) - _centred(_lon_lat(origin))
    east, north = _axes(origin)[:2] @ moved.T
    x = east * np.sin(bearing) + north * np.cos(bearing)
    y = -east * np.cos(bearing) + north * np.sin(bearing)
    return np.column_stack([x, y])


def bearings_deg(origin: Origin, heading_rad: F64) -> F64:
    """Headings of the map (counter-clockwise from x) as degrees clockwise from north."""
    return np.asarray((origin.bearing_deg - np.rad2deg(heading_rad)) % 360)


def _lon_lat(origin: Origin) -> F64:
    return np.array([[origin.longitude_deg, origin.latitude_deg]])


def _axes(origin: Origin) -> F64:
    """East, north and up at the origin, as rows in Earth-centred axes."""
    lon, lat = np.deg2rad([origin.longitude_deg, origin.latitude_deg])
    return np.array(
        [
            [-np.sin(lon), np.cos(lon), 0.0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )


def _centred(lon_lat_deg: F64) -> F64:
    """Earth-centred positions (n, 3) of points (n, 2) on the ellipsoid."""
    lon, lat = np.deg2rad(lon_lat_deg).T
    normal = MAJOR_M / np.sqrt(1 - ECCENTRICITY2 * np.sin(lat) ** 2)
    across = normal * np.cos(lat)
    up = normal * (1 - ECCENTRICITY2) * np.sin(lat)
    return np.column_stack([across * np.cos(lon), across * np.sin(lon), up])


def _geodetic(place_m: F64) -> F64:
    """Longitudes and latitudes (n, 2) below Earth-centred positions (n, 3)."""
    x, y, z = place_m.T
    across = np.hypot(x, y)
    lat = np.arctan2(z, across * (1 - ECCENTRICITY2))
    for _ in range(ROUNDS):
        normal = MAJOR_M / np.sqrt(1 - ECCENTRICITY2 * np.sin(lat) ** 2)
        lat = np.arctan2(z + ECCENTRICITY2 * normal * np.sin(lat), across)
    return np.asarray(np.rad2deg(np.column_stack([np.arctan2(y, x), lat])))
