"""Whether a building is where a phone believes itself to be."""

from __future__ import annotations

import math
from dataclasses import dataclass

from elfslam.base.parameters import parameter

EARTH_M_PER_DEG = 111_195.0
"""Of latitude, on a sphere of 6,371 km: a third of a percent off at worst."""
HIGHEST_DEG = 89.0


@dataclass(frozen=True)
class PositionFindParameters:
    """How far a coarse position tells the building."""

    reach_sigmas: float = parameter(4.0, "", "buildings further away are not asked for", low=1.0)
    around_m: float = parameter(
        500.0, "m", "one building stands for all within this of a phone", low=10.0
    )
    largest_m: float = parameter(
        600.0, "m", "radius of the largest floor that is found from its edge", low=50.0
    )


@dataclass(frozen=True)
class Place:
    """Where a phone believes itself to be; the altitude where it knows one."""

    latitude_deg: float
    longitude_deg: float
    sigma_m: float
    altitude_m: float | None = None
    altitude_sigma_m: float | None = None


@dataclass(frozen=True)
class Site:
    """Where a floor lies: the middle and radius of a disc around it."""

    latitude_deg: float
    longitude_deg: float
    radius_m: float
    altitude_m: float | None = None


def reach_m(place: Place, parameters: PositionFindParameters) -> float:
    """How far away the edge of a floor may be that is asked for."""
    return place.sigma_m * parameters.reach_sigmas


def box_deg(place: Place, parameters: PositionFindParameters) -> tuple[float, float, float, float]:
    """South, west, north and east of where the middles of floors are looked for."""
    high = (reach_m(place, parameters) + parameters.largest_m) / EARTH_M_PER_DEG
    steepest = min(abs(place.latitude_deg) + high, HIGHEST_DEG)
    wide = high / math.cos(math.radians(steepest))
    return (
        place.latitude_deg - high,
        place.longitude_deg - wide,
        place.latitude_deg + high,
        place.longitude_deg + wide,
    )


def distance_m(place: Place, site: Site) -> float:
    """Between the phone and the middle of a floor (flat around the phone)."""
    north = site.latitude_deg - place.latitude_deg
    east = (site.longitude_deg - place.longitude_deg + 180) % 360 - 180
    return EARTH_M_PER_DEG * math.hypot(north, east * math.cos(math.radians(place.latitude_deg)))


def position_log_odds(place: Place, site: Site, parameters: PositionFindParameters) -> float:
    """What a position says for a floor, against being anywhere else around.

    The phone is anywhere on the floor's disc, or anywhere within `around_m`; its error is Gaussian.
    """
    outside_m = max(0.0, distance_m(place, site) - site.radius_m)
    density = site.radius_m**2 + 2 * place.sigma_m**2
    around = parameters.around_m**2 + 2 * place.sigma_m**2
    told = math.log(around / density) - 0.5 * (outside_m / place.sigma_m) ** 2
    if place.altitude_m is not None and place.altitude_sigma_m and site.altitude_m is not None:
        told -= 0.5 * ((place.altitude_m - site.altitude_m) / place.altitude_sigma_m) ** 2
    return told
