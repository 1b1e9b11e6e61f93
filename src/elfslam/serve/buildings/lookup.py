"""Looks up in the database what a phone tells: two queries, whatever it tells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import sqlalchemy as sa
from sqlalchemy.engine import Connection
from sqlalchemy.orm import InstrumentedAttribute

from elfslam.serve.buildings import senses
from elfslam.serve.buildings.find import Answer, Asked, Evidence, FindParameters, KnownFloor, decide
from elfslam.serve.store.database import POSTGRESQL
from elfslam.serve.store.tables import Building, Floor, FloorPoint

Key = TypeVar("Key", int, str)
MOST_FLOORS = 64
"""So many of the likeliest by each sense are looked at by the others."""
POINTS = sa.select(
    FloorPoint.bssid, FloorPoint.floor, FloorPoint.level_dbm, FloorPoint.spread_db, FloorPoint.share
)
FLOORS = sa.select(
    Floor.number, Building.name, Floor.level, Floor.id, Floor.revision, Floor.has_wifi,
    Floor.latitude_deg, Floor.longitude_deg, Floor.radius_m, Floor.altitude_m,
).join(Building, Floor.building == Building.number)  # fmt: skip
AROUND = sa.and_(
    Floor.latitude_deg.between(sa.bindparam("south"), sa.bindparam("north")),
    sa.or_(
        Floor.longitude_deg.between(sa.bindparam("west"), sa.bindparam("east")),
        Floor.longitude_deg.between(sa.bindparam("west_too"), sa.bindparam("east_too")),
    ),
    sa.func.abs(Floor.latitude_deg - sa.bindparam("latitude", type_=sa.Float))
    * senses.EARTH_M_PER_DEG
    < Floor.radius_m + sa.bindparam("reach", type_=sa.Float),
)


@dataclass(frozen=True)
class Statements:
    """What is asked of a database, made once."""

    points: sa.Select[Any]
    by_number: sa.Select[Any]
    by_place: sa.Select[Any]
    by_both: sa.Select[Any]


def statements(*, arrays: bool) -> Statements:
    """With a list as one parameter, which can be prepared, or as one for each of its values."""

    def among(column: InstrumentedAttribute[Any], name: str, kind: Any) -> sa.ColumnElement[bool]:
        if arrays:
            return column == sa.any_(sa.bindparam(name, type_=sa.ARRAY(kind)))
        return column.in_(sa.bindparam(name, type_=kind, expanding=True))

    likely = sa.or_(
        among(Floor.number, "numbers", sa.Integer), among(Floor.id, "map_ids", sa.String)
    )
    points: Any = POINTS
    floors: Any = FLOORS
    return Statements(
        points.where(among(FloorPoint.bssid, "bssids", sa.BigInteger)),
        floors.where(likely),
        floors.where(AROUND),
        floors.where(sa.or_(likely, AROUND)),
    )


STATEMENTS = {arrays: statements(arrays=arrays) for arrays in (False, True)}


def _statements(connection: Connection) -> Statements:
    return STATEMENTS[connection.dialect.name == POSTGRESQL]


def find(
    connection: Connection, index: senses.EchoIndex | None, asked: Asked, parameters: FindParameters
) -> Answer:
    """Which floor a phone is on."""
    scan = senses.scan_of(asked.wifi, parameters.wifi)
    wifi = echo = None
    if len(scan.bssid):
        wifi = senses.wifi_log_odds(scan, _known_points(connection, scan), parameters.wifi)
    if asked.vectors is not None and index is not None and asked.encoder == index.encoder:
        echo = senses.echo_evidence(asked.vectors, index, parameters.echo)
    likely: dict[str, Sequence[object]] = {
        "numbers": _likeliest({} if wifi is None else wifi),
        "map_ids": _likeliest({} if echo is None else echo.odds),
    }
    floors = _floors(connection, likely, asked.place, parameters.position)
    silent = len(scan.bssid) * math.log(parameters.wifi.new_share)
    return decide(floors, Evidence(wifi, silent, asked.place, echo), parameters)


def _known_points(connection: Connection, scan: senses.Scan) -> senses.KnownPoints:
    rows = connection.execute(_statements(connection).points, {"bssids": scan.bssid.tolist()}).all()
    table = np.array([*map(tuple, rows)], dtype=np.float64).reshape(-1, 5)  # 48 bits are exact
    order = np.argsort(scan.bssid)
    heard = order[np.searchsorted(scan.bssid, table[:, 0].astype(np.int64), sorter=order)]
    return senses.KnownPoints(heard, table[:, 1].astype(np.int64), *table[:, 2:].T)


def _likeliest(odds: Mapping[Key, float]) -> list[Key]:
    return sorted(odds, key=lambda each: -odds[each])[:MOST_FLOORS]


def _floors(
    connection: Connection,
    likely: Mapping[str, Sequence[object]],
    place: senses.Place | None,
    parameters: senses.PositionFindParameters,
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


def _around(place: senses.Place, parameters: senses.PositionFindParameters) -> dict[str, float]:
    """The box around a place, and beyond the date line its other part."""
    south, west, north, east = senses.box_deg(place, parameters)
    turn = 360.0 if west < -180 else -360.0
    return {
        "south": south, "north": north, "west": west, "east": east,
        "west_too": west + turn, "east_too": east + turn,
        "latitude": place.latitude_deg, "reach": senses.reach_m(place, parameters),
    }  # fmt: skip


def _known(row: Sequence[Any]) -> KnownFloor:
    number, building, level, map_id, revision, has_wifi, *site = row
    return KnownFloor(number, building, level, map_id, revision, senses.Site(*site), has_wifi)
