"""What a floor is published from: a map on disk with its walks, or a map of the server."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from elfslam.base.errors import InputError
from elfslam.base.values import WifiScans
from elfslam.data.map_files import ENCODER, MAP, is_superimposed, read_map
from elfslam.data.sensor_files import read_wifi
from elfslam.serve.buildings.publishing import NewFloor, Spot
from elfslam.serve.buildings.wifi import FloorPoints, WifiFindParameters, points_on
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.people.access import ID
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Map, MapFile, RecordingFile, reading
from elfslam.serve.store.sending import unfolded

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
    points = _points(scans, parameters)
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
            raise InputError(f"map {map_id}: is not on this server; check the id and --data")
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


def _points(scans: list[WifiScans], parameters: WifiFindParameters) -> FloorPoints | None:
    return points_on(scans, parameters) if scans else None
