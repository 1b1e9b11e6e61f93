"""Looks up in the database what a phone tells: two queries, whatever it tells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from sqlalchemy import (
    ARRAY,
    BigInteger,
    ColumnElement,
    Float,
    Integer,
    Select,
    String,
    and_,
    any_,
    bindparam,
    func,
    or_,
    select,
)
from sqlalchemy.engine import Connection
from sqlalchemy.orm import InstrumentedAttribute

from elfslam.serve.buildings.find import Answer, Asked, Evidence, FindParameters, KnownFloor, decide
from elfslam.serve.buildings.senses import (
    EARTH_M_PER_DEG,
    EchoIndex,
    KnownPoints,
    Place,
    PositionFindParameters,
    Scan,
    Site,
    box_deg,
    echo_evidence,
    reach_m,
    scan_of,
    wifi_log_odds,
)
from elfslam.serve.store.database import POSTGRESQL
from elfslam.serve.store.tables import Building, Floor, FloorPoint

Key = TypeVar("Key", int, str)
MOST_FLOORS = 64
"""So many of the likeliest by each sense are looked at by the others."""
POINTS = select(
    FloorPoint.bssid, FloorPoint.floor, FloorPoint.level_dbm, FloorPoint.spread_db, FloorPoint.share
)
FLOORS = select(
    Floor.number, Building.name, Floor.level, Floor.id, Floor.revision, Floor.has_wifi,
    Floor.latitude_deg, Floor.longitude_deg, Floor.radius_m, Floor.altitude_m,
).join(Building, Floor.building == Building.number)  # fmt: skip
AROUND = and_(
    Floor.latitude_deg.between(bindparam("south"), bindparam("north")),
    or_(
        Floor.longitude_deg.between(bindparam("west"), bindparam("east")),
        Floor.longitude_deg.between(bindparam("west_too"), bindparam("east_too")),
    ),
    func.abs(Floor.latitude_deg - bindparam("latitude", type_=Float)) * EARTH_M_PER_DEG
    < Floor.radius_m + bindparam("reach", type_=Float),
)


@dataclass(frozen=True)
class Statements:
    """What is asked of a database, made once."""

    points: Select[Any]
    by_number: Select[Any]
    by_place: Select[Any]
    by_both: Select[Any]


def statements(*, arrays: bool) -> Statements:
    """With a list as one parameter, which can be prepared, or as one for each of its values."""

    def among(column: InstrumentedAttribute[Any], name: str, kind: Any) -> ColumnElement[bool]:
        if arrays:
            return column == any_(bindparam(name, type_=ARRAY(kind)))
        return column.in_(bindparam(name, type_=kind, expanding=True))

    likely = or_(among(Floor.number, "numbers", Integer), among(Floor.id, "map_ids", String))
    points: Any = POINTS
    floors: Any = FLOORS
    return Statements(
        points.where(among(FloorPoint.bssid, "bssids", BigInteger)),
        floors.where(likely),
        floors.where(AROUND),
        floors.where(or_(likely, AROUND)),
    )


STATEMENTS = {arrays: statements(arrays=arrays) for arrays in (False, True)}


def _statements(connection: Connection) -> Statements:
    return STATEMENTS[connection.dialect.name == POSTGRESQL]


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
    rows = connection.execute(_statements(connection).points, {"bssids": scan.bssid.tolist()}).all()
    table = np.array([*map(tuple, rows)], dtype=np.float64).reshape(-1, 5)  # 48 bits are exact
    order = np.argsort(scan.bssid)
    heard = order[np.searchsorted(scan.bssid, table[:, 0].astype(np.int64), sorter=order)]
    return KnownPoints(heard, table[:, 1].astype(np.int64), *table[:, 2:].T)


def _likeliest(odds: Mapping[Key, float]) -> list[Key]:
    return sorted(odds, key=lambda each: -odds[each])[:MOST_FLOORS]


def _floors(
    connection: Connection,
    likely: Mapping[str, Sequence[object]],
    place: Place | None,
    parameters: PositionFindParameters,
) -> list[KnownFloor]:
    """The floors of these numbers and maps, and those around a place."""
    wanted = _statements(connection)
    if place is None:
        rows = connection.execute(wanted.by_number, likely)
    elif any(likely.values()):
        rows = connection.execute(wanted.by_both, {**likely, **_around(place, parameters)})
    else:
        rows = connection.execute(wanted.by_place, _around(place, parameters))
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
