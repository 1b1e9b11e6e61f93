"""Looks up in the database what a phone tells: two queries, whatever it tells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from sqlalchemy import BigInteger, Float, Integer, String, and_, bindparam, func, or_, select
from sqlalchemy.engine import Connection

from elfslam.serve.buildings.echoes import EchoIndex, echo_evidence
from elfslam.serve.buildings.find import (
    Answer,
    Asked,
    Evidence,
    FindParameters,
    KnownFloor,
    decide,
)
from elfslam.serve.buildings.position import (
    EARTH_M_PER_DEG,
    Place,
    PositionFindParameters,
    Site,
    box_deg,
    reach_m,
)
from elfslam.serve.buildings.tables import Building, Floor, FloorPoint
from elfslam.serve.buildings.wifi import KnownPoints, Scan, scan_of, wifi_log_odds

Key = TypeVar("Key", int, str)
MOST_FLOORS = 64
"""So many of the likeliest by each sense are looked at by the others."""
POINTS = select(
    FloorPoint.bssid, FloorPoint.floor, FloorPoint.level_dbm, FloorPoint.spread_db, FloorPoint.share
).where(FloorPoint.bssid.in_(bindparam("bssids", type_=BigInteger, expanding=True)))
FLOORS = select(
    Floor.number, Building.name, Floor.level, Floor.id, Floor.revision, Floor.has_wifi,
    Floor.latitude_deg, Floor.longitude_deg, Floor.radius_m, Floor.altitude_m,
).join(Building, Floor.building == Building.number)  # fmt: skip
LIKELY = or_(
    Floor.number.in_(bindparam("numbers", type_=Integer, expanding=True)),
    Floor.id.in_(bindparam("map_ids", type_=String, expanding=True)),
)
AROUND = and_(
    Floor.latitude_deg.between(bindparam("south"), bindparam("north")),
    or_(
        Floor.longitude_deg.between(bindparam("west"), bindparam("east")),
        Floor.longitude_deg.between(bindparam("west_too"), bindparam("east_too")),
    ),
    func.abs(Floor.latitude_deg - bindparam("latitude", type_=Float)) * EARTH_M_PER_DEG
    < Floor.radius_m + bindparam("reach", type_=Float),
)
BY_NUMBER, BY_PLACE, BY_BOTH = (
    FLOORS.where(each) for each in (LIKELY, AROUND, or_(LIKELY, AROUND))
)


def find(
    connection: Connection, index: EchoIndex | None, asked: Asked, parameters: FindParameters
) -> Answer:
    """Which floor a phone is on."""
    scan = scan_of(asked.wifi, parameters.wifi)
    wifi = echo = None
    if len(scan.bssid):
        wifi = wifi_log_odds(scan, _known_points(connection, scan), parameters.wifi)
    if asked.vectors is not None and index is not None and asked.encoder == index.encoder:
        echo = echo_evidence(asked.vectors, index, parameters.echo)
    likely: dict[str, Sequence[object]] = {
        "numbers": _likeliest({} if wifi is None else wifi),
        "map_ids": _likeliest({} if echo is None else echo.odds),
    }
    floors = _floors(connection, likely, asked.place, parameters.position)
    silent = len(scan.bssid) * math.log(parameters.wifi.new_share)
    return decide(floors, Evidence(wifi, silent, asked.place, echo), parameters)


def _known_points(connection: Connection, scan: Scan) -> KnownPoints:
    rows = connection.execute(POINTS, {"bssids": scan.bssid.tolist()}).all()
    place = {bssid: k for k, bssid in enumerate(scan.bssid.tolist())}
    whole = np.array([(place[row[0]], row[1]) for row in rows], dtype=np.int64).reshape(-1, 2)
    told = np.array([row[2:] for row in rows], dtype=np.float64).reshape(-1, 3)
    return KnownPoints(*whole.T, *told.T)


def _likeliest(odds: Mapping[Key, float]) -> list[Key]:
    return sorted(odds, key=lambda each: -odds[each])[:MOST_FLOORS]


def _floors(
    connection: Connection,
    likely: Mapping[str, Sequence[object]],
    place: Place | None,
    parameters: PositionFindParameters,
) -> list[KnownFloor]:
    """The floors of these numbers and maps, and those around a place."""
    if place is None:
        rows = connection.execute(BY_NUMBER, likely)
    elif any(likely.values()):
        rows = connection.execute(BY_BOTH, {**likely, **_around(place, parameters)})
    else:
        rows = connection.execute(BY_PLACE, _around(place, parameters))
    return [_known(row) for row in rows]


def _around(place: Place, parameters: PositionFindParameters) -> dict[str, float]:
    """The box around a place, and beyond the date line its other part."""
    south, west, north, east = box_deg(place, parameters)
    turn = 360.0 if west < -180 else -360.0
    return {
        "south": south, "north": north, "west": west, "east": east,
        "west_too": west + turn, "east_too": east + turn,
        "latitude": place.latitude_deg, "reach": reach_m(place, parameters),
    }  # fmt: skip


def _known(row: Sequence[Any]) -> KnownFloor:
    number, building, level, map_id, revision, has_wifi, *site = row
    return KnownFloor(number, building, level, map_id, revision, Site(*site), has_wifi)
