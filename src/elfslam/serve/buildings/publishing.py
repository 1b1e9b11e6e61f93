"""Floors are published whole: their parts first, then all rows in one commit.

Whoever is killed between has only left parts that no row names, which `sweep` deletes. Publishers
share a lock that sweeping takes alone, so that no part goes while somebody begins to name it. A
floor comes from a map on disk with its walks, or from a map of the server.
"""

import fcntl
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sqlalchemy import delete, func, insert, select, text
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import FloorMap, WifiScans
from elfslam.data.map_files import ENCODER, MAP, is_superimposed, read_map
from elfslam.data.sensor_files import read_wifi
from elfslam.serve.buildings import files as store
from elfslam.serve.buildings.files import Files, open_files
from elfslam.serve.buildings.senses import HIGHEST_DEG, FloorPoints, WifiFindParameters, points_on
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.maps.bodies import floor_name
from elfslam.serve.maps.package import (
    Json,
    Sources,
    check_encoder,
    content_of,
    manifest_of,
    phone_parameters,
)
from elfslam.serve.people.access import ID
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.sending import unfolded
from elfslam.serve.store.tables import (
    Building,
    Floor,
    FloorPart,
    FloorPoint,
    Map,
    MapFile,
    RecordingFile,
    new_id,
    now_utc,
)

ADVISORY_LOCK = 0x656C_6673
"""PostgreSQL knows locks by numbers."""
LOCK = ".publishing"
LEVELS = range(-100, 1000)
LEAST_RADIUS_M = 5.0


@dataclass(frozen=True)
class Spot:
    """Where a floor is: of which building, which level, and where on the Earth its middle lies."""

    building: str
    level: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None = None


@dataclass(frozen=True, eq=False)
class NewFloor:
    """A floor to be published. `points` is None where no walk scanned for Wi-Fi."""

    spot: Spot
    floor_map: FloorMap
    encoder: bytes
    points: FloorPoints | None = None
    floor_plan: tuple[bytes, Json] | None = None
    """The image, and what the database knows of it."""


@dataclass(frozen=True)
class Published:
    """A floor that is there: its map's id and revision, and how much it takes."""

    map_id: str
    revision: int
    parts: int
    parts_bytes: int
    points: int


def publish(services: Services, new: NewFloor) -> Published:
    """Publish a floor, or a new revision of it. Raises InputError, StoreError."""
    _check(new.spot)
    files = open_files(services.settings)
    with holding(services, alone=False):
        content, sizes, sources = _put_parts(files, new)
        try:
            with transaction(services.sessions) as session:
                floor, dropped = _kept(session, new, content, sizes, sources)
        except IntegrityError as error:
            raise StoreError(
                f"{new.spot.building}, floor {new.spot.level}: somebody else publishes it at this "
                "moment; try again"
            ) from error
    drop_unnamed(services, dropped)
    count = 0 if new.points is None else len(new.points.bssid)
    return Published(floor.id, floor.revision, len(sizes), sum(sizes.values()), count)


def withdraw(services: Services, building: str, level: int) -> None:
    """Forget a floor, and the building with its last one. Raises InputError where there is none."""
    with transaction(services.sessions) as session:
        found = _floor(session, building, level)
        if found is None:
            raise InputError(
                f"{building}, floor {level}: is not published; elfslam buildings lists what is"
            )
        dropped = _parts(session, found.number)
        session.execute(delete(Floor).where(Floor.number == found.number))
        left = session.scalar(select(Floor.number).filter_by(building=found.building).limit(1))
        if left is None:
            session.execute(delete(Building).where(Building.number == found.building))
    drop_unnamed(services, dropped)


def drop_unnamed(services: Services, sha256s: Iterable[str]) -> None:
    """Delete those files that no floor names any more; call it after the commit."""
    wanted = set(sha256s)
    if not wanted:
        return
    with holding(services, alone=True):
        with reading(services.sessions) as session:
            named = set(
                session.scalars(select(FloorPart.sha256).where(FloorPart.sha256.in_(wanted)))
            )
        store.delete(open_files(services.settings), wanted - named)


def sweep(services: Services) -> int:
    """Delete every file that no floor names; how many those were.

    Raises StoreError, also where none of the files is named: they are another database's.
    """
    files = open_files(services.settings)
    with holding(services, alone=True):
        with reading(services.sessions) as session:
            named = set(session.scalars(select(FloorPart.sha256).distinct()))
        there = set(store.listed(files))
        if there and not there & named:
            raise StoreError(
                f"files at {files.url}: no floor of this database names any of the {len(there)} "
                "that lie there; give the database that they were published with",
                argument="database",
            )
        store.delete(files, there - named)
    return len(there - named)


@contextmanager
def holding(services: Services, *, alone: bool) -> Iterator[None]:
    """With other publishers, or alone, among all processes that use the database."""
    if services.engine.dialect.name == "postgresql":
        kind = "" if alone else "_shared"
        with services.engine.connect() as connection:
            connection.execute(text(f"SELECT pg_advisory_xact_lock{kind}({ADVISORY_LOCK})"))
            yield
        return
    with (services.settings.data_folder / LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield


def radius_m(floor_map: FloorMap) -> float:
    """Of the disc around the middle of a map that holds all its spots."""
    low, high = floor_map.xy_m.min(axis=0), floor_map.xy_m.max(axis=0)
    away = np.linalg.norm(floor_map.xy_m - (low + high) / 2, axis=1)
    return max(float(away.max()), LEAST_RADIUS_M)


def _check(spot: Spot) -> None:
    good = abs(spot.latitude_deg) <= HIGHEST_DEG and abs(spot.longitude_deg) <= 180
    if not (good and spot.level in LEVELS):
        raise InputError(
            f"{spot.building}: got floor {spot.level} at {spot.latitude_deg},{spot.longitude_deg}; "
            f"wanted a floor from {LEVELS[0]} to {LEVELS[-1]}, latitude within {HIGHEST_DEG:g} and "
            "longitude within 180 degrees"
        )


def _put_parts(files: Files, new: NewFloor) -> tuple[Json, dict[str, int], Sources]:
    """Keep the parts of a package; what its manifest says of them, their sizes, and its sources."""
    sizes: dict[str, int] = {}

    def kept(content: bytes) -> Blob:
        blob = Blob(store.put(files, content), len(content))
        sizes[blob.sha256] = blob.size_bytes
        return blob

    encoder = kept(new.encoder)
    check_encoder(new.floor_map, encoder)
    content = content_of(new.floor_map, encoder, kept)
    plan = {} if new.floor_plan is None else {FLOOR_PLAN: kept(new.floor_plan[0])}
    name = f"{new.spot.building}, floor {new.spot.level}"
    place = {"venue": new.spot.building, "floor": floor_name(new.spot.level)}
    told = None if new.floor_plan is None else new.floor_plan[1]
    return content, sizes, Sources(name, plan, told, phone_parameters(), place)


def _kept(
    session: Session, new: NewFloor, content: Json, sizes: dict[str, int], sources: Sources
) -> tuple[Floor, list[str]]:
    """The rows of a floor, and the SHA-256 of what they named before."""
    floor = _floor(session, new.spot.building, new.spot.level) or _new_row(session, new.spot)
    before = _parts(session, floor.number)
    # In seconds of this age, as of other maps: it grows even after a floor was withdrawn.
    floor.revision = max(int(time.time()), (floor.revision or 0) + 1)
    floor.published_utc = now_utc()
    floor.manifest = manifest_of(
        floor.id, sources, content, revision=floor.revision, made_utc=floor.published_utc
    )
    floor.latitude_deg, floor.longitude_deg = new.spot.latitude_deg, new.spot.longitude_deg
    floor.radius_m, floor.altitude_m = radius_m(new.floor_map), new.spot.altitude_m
    floor.has_wifi = new.points is not None and len(new.points.bssid) > 0
    session.add(floor)
    session.flush()
    parts = [{"floor": floor.number, "sha256": k, "size_bytes": n} for k, n in sizes.items()]
    for table, rows in ((FloorPart, parts), (FloorPoint, _point_rows(floor.number, new.points))):
        session.execute(delete(table).where(table.floor == floor.number))
        if rows:
            session.execute(insert(table), rows)
    return floor, [sha256 for sha256 in before if sha256 not in sizes]


def _new_row(session: Session, spot: Spot) -> Floor:
    building = session.scalar(select(Building).filter_by(name=spot.building))
    if building is None:
        building = Building(name=spot.building)
        session.add(building)
        session.flush()
    return Floor(id=new_id(), building=building.number, level=spot.level)


def _floor(session: Session, building: str, level: int) -> Floor | None:
    """Held against other publishers until the commit."""
    wanted = select(Floor).join(Building).where(Building.name == building, Floor.level == level)
    return session.scalar(wanted.with_for_update(of=Floor))


def _parts(session: Session, number: int | None) -> list[str]:
    return list(session.scalars(select(FloorPart.sha256).filter_by(floor=number)))


def _point_rows(number: int, points: FloorPoints | None) -> list[dict[str, float]]:
    if points is None:
        return []
    columns = (points.bssid, points.level_dbm, points.spread_db, points.share)
    names = ("bssid", "level_dbm", "spread_db", "share")
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [{"floor": number, **dict(zip(names, row, strict=True))} for row in rows]


WIFI = "wifi.csv"


def floor_of(
    services: Services,
    source: str,
    spot: Spot,
    heard: Sequence[Path],
    parameters: WifiFindParameters,
) -> NewFloor:
    """A floor from a folder of a map, or from a map of the server by its id.

    `heard` are recordings of walks there; a map of the server brings those that it came from.
    Raises InputError, StoreError.
    """
    if Path(source).is_dir():
        return _of_folder(Path(source), spot, _scans(heard), parameters)
    if not ID.fullmatch(source):
        raise InputError(f"{source}: is neither the folder of a map nor the id of one; check it")
    return _of_server(services, source, spot, _scans(heard), parameters)


def _of_folder(
    folder: Path, spot: Spot, scans: list[WifiScans], parameters: WifiFindParameters
) -> NewFloor:
    encoder = folder / ENCODER
    if not encoder.is_file():
        raise InputError(f"{folder}: has no {ENCODER}; map the floor by its echoes")
    if is_superimposed(folder):
        raise InputError(f"{folder}: phones need headings; publish the map it was made of")
    points = points_on(scans, parameters) if scans else None
    return NewFloor(spot, read_map(folder), encoder.read_bytes(), points)


def _of_server(
    services: Services,
    map_id: str,
    spot: Spot,
    scans: list[WifiScans],
    parameters: WifiFindParameters,
) -> NewFloor:
    settings = services.settings
    with reading(services.sessions) as session:
        found = session.get(Map, map_id)
        if found is None:
            raise InputError(
                f"map {map_id}: is not on this server; check the id and the data folder",
                argument="data",
            )
        named = {row.name: row.sha256 for row in session.query(MapFile).filter_by(map_id=map_id)}
        walks = session.query(RecordingFile.sha256).filter(
            RecordingFile.recording_id.in_(found.sources), RecordingFile.name == WIFI
        )
        tables = {f"{k}.csv": sha256 for k, (sha256,) in enumerate(walks)}
        plan, placed = named.get(FLOOR_PLAN), found.floor_plan
    with unfolded(settings, tables) as folder:
        scans += [read_wifi(folder / name) for name in tables]
    wanted = {name: named[name] for name in (MAP, ENCODER) if name in named}
    with unfolded(settings, wanted) as folder:
        new = _of_folder(folder, spot, scans, parameters)
    if plan is None or placed is None:
        return new
    image = blobs.found_blob(settings.blobs_folder, plan).read_bytes()
    return NewFloor(spot, new.floor_map, new.encoder, new.points, (image, placed))


def _scans(recordings: Sequence[Path]) -> list[WifiScans]:
    for recording in recordings:
        if not (recording / WIFI).is_file():
            raise InputError(f"{recording}: has no {WIFI}; wanted a recording with Wi-Fi scans")
    return [read_wifi(recording / WIFI) for recording in recordings]


def published_rows(services: Services) -> list[dict[str, object]]:
    """A row a floor: building, floor, where it lies, its map, and how much that takes."""
    size = select(func.sum(FloorPart.size_bytes)).where(FloorPart.floor == Floor.number)
    points = select(func.count()).where(FloorPoint.floor == Floor.number)
    wanted = select(
        Building.name, Floor.level, Floor.latitude_deg, Floor.longitude_deg, Floor.id,
        Floor.revision, points.scalar_subquery(), size.scalar_subquery(),
    ).join(Building).order_by(Building.name, Floor.level)  # fmt: skip
    names = ("building", "floor", "at", "map", "revision", "access points", "bytes")
    with reading(services.sessions) as session:
        return [
            dict(zip(names, (name, level, f"{lat:.6f},{lon:.6f}", *others), strict=True))
            for name, level, lat, lon, *others in session.execute(wanted)
        ]
