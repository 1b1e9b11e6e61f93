"""Looks up in the database what a phone tells: two queries, whatever it tells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from sqlalchemy import BigInteger, ColumnElement, and_, bindparam, false, or_, select
from sqlalchemy.engine import Connection

from elfslam.serve.buildings.echoes import EchoIndex, echo_log_odds
from elfslam.serve.buildings.find import (
    Answer,
    Asked,
    Evidence,
    FindParameters,
    KnownFloor,
    decide,
)
from elfslam.serve.buildings.position import Place, PositionFindParameters, Site, box_deg
from elfslam.serve.buildings.tables import Building, Floor, FloorPoint
from elfslam.serve.buildings.wifi import KnownPoints, Scan, scan_of, wifi_log_odds

MOST_FLOORS = 64
"""So many of the likeliest by each sense are looked at by the others."""
POINTS = select(
    FloorPoint.bssid, FloorPoint.floor, FloorPoint.level_dbm, FloorPoint.spread_db, FloorPoint.share
).where(FloorPoint.bssid.in_(bindparam("bssids", type_=BigInteger, expanding=True)))

FLOORS = select(
    Floor.number, Building.name, Floor.level, Floor.id, Floor.revision, Floor.has_wifi,
    Floor.latitude_deg, Floor.longitude_deg, Floor.radius_m, Floor.altitude_m,
).join(Building, Floor.building == Building.number)  # fmt: skip


def find(
    connection: Connection, index: EchoIndex | None, asked: Asked, parameters: FindParameters
) -> Answer:
    """Which floor a phone is on."""
    scan = scan_of(asked.wifi, parameters.wifi)
    wifi = echo = None
    if len(scan.bssid):
        wifi = wifi_log_odds(scan, _known_points(connection, scan), parameters.wifi)
    if asked.vectors is not None and index is not None and asked.encoder == index.encoder:
        echo = echo_log_odds(asked.vectors, index, parameters.echo)
    likely = _likeliest(wifi or {}) | _likeliest(echo or {})
    floors = _floors(connection, likely, asked.place, parameters.position)
    silent = len(scan.bssid) * math.log(parameters.wifi.new_share)
    return decide(floors, Evidence(wifi, silent, asked.place, echo), parameters)


def _known_points(connection: Connection, scan: Scan) -> KnownPoints:
    rows = connection.execute(POINTS, {"bssids": scan.bssid.tolist()}).all()
    place = {bssid: k for k, bssid in enumerate(scan.bssid.tolist())}
    whole = np.array([(place[row[0]], row[1]) for row in rows], dtype=np.int64).reshape(-1, 2)
    told = np.array([row[2:] for row in rows], dtype=np.float64).reshape(-1, 3)
    return KnownPoints(*whole.T, *told.T)


def _likeliest(odds: Mapping[int, float]) -> set[int]:
    return set(sorted(odds, key=lambda number: -odds[number])[:MOST_FLOORS])


def _floors(
    connection: Connection,
    numbers: Iterable[int],
    place: Place | None,
    parameters: PositionFindParameters,
) -> list[KnownFloor]:
    """The floors of these numbers, and those around a place."""
    wanted = or_(
        Floor.number.in_(sorted(numbers)),
        false() if place is None else _around(box_deg(place, parameters)),
    )
    return [_known(row) for row in connection.execute(FLOORS.where(wanted))]


def _around(box: Sequence[float]) -> ColumnElement[bool]:
    south, west, north, east = box
    turns = (turn for turn in (-360.0, 0.0, 360.0) if west + turn <= 180 and east + turn >= -180)
    return and_(
        Floor.latitude_deg.between(south, north),
        or_(*(Floor.longitude_deg.between(west + turn, east + turn) for turn in turns)),
    )


def _known(row: Sequence[Any]) -> KnownFloor:
    number, building, level, map_id, revision, has_wifi, *site = row
    return KnownFloor(number, building, level, map_id, revision, Site(*site), has_wifi)
