"""Maps and recordings of a server, put where jobs and uploads would have left them."""

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx
import numpy as np
from PIL import Image
from sqlalchemy import select

from elfslam.base.values import FloorMap, Payload
from elfslam.data.map_files import ENCODER, MAP, write_map
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Map, MapFile, Recording, RecordingFile, User
from elfslam.stages.feature import OnnxEncoder, load_encoder


def plant_files(services: Services, row: Map | Recording, folder: Path | None = None) -> str:
    """A row, new or known, and all that lies in a folder as its files; gives the row's id."""
    store = services.settings.blobs_folder
    with blobs.locked(store), transaction(services.sessions) as session:
        session.add(row)
        session.flush()
        for name, blob in (blobs.put_folder(store, folder) if folder else {}).items():
            told = {"name": name, "sha256": blob.sha256, "size_bytes": blob.size_bytes}
            if isinstance(row, Map):
                session.merge(MapFile(map_id=row.id, **told))
            else:
                session.merge(RecordingFile(recording_id=row.id, **told))
        return row.id


@contextmanager
def opened(data: Path) -> Iterator[Services]:
    """What the server of a data folder works with, beside it."""
    services = open_services(ServerSettings(data))
    yield services
    services.engine.dispose()


def plant_floor_map(
    data: Path, floor_map: FloorMap, map_id: str | None = None, encoder: bytes | None = None
) -> str:
    """A map of the owner's of a server, or another content of one; gives the id."""
    shipped = load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    with opened(data) as services, TemporaryDirectory() as name:
        write_map(floor_map, Path(name, MAP))
        Path(name, ENCODER).write_bytes(encoder or shipped.content)
        with reading(services.sessions) as session:
            owner = session.scalars(select(User).filter_by(is_owner=True)).one()
            row = session.get(Map, map_id or "") or Map(user_id=owner.id, name="Hall", kind="run")
        return plant_files(services, row, Path(name))


def floor_map_of(xy_m: np.ndarray, vectors: np.ndarray, heading_rad: float = 0.0) -> FloorMap:
    """The spots of a walk, known to 10 cm, with vectors as of the encoder that is shipped."""
    count, elf = len(xy_m), Payload("elf", load_encoder("compact").identity, vectors)
    walk, spread = np.zeros(count, dtype=np.int64), np.tile(0.01 * np.eye(2), (count, 1, 1))
    heading = np.full(count, heading_rad)
    return FloorMap(xy_m, heading, walk, np.arange(count), spread, (elf,), "", ("walk",))


def picture(kind: str = "PNG", width: int = 40, height: int = 30, turned: int = 0) -> bytes:
    """A white picture; turned as its Exif says."""
    content, exif = io.BytesIO(), Image.Exif()
    if turned:
        exif[0x0112] = turned
    Image.new("RGB", (width, height), "white").save(content, kind, exif=exif)
    return content.getvalue()


def put_plan(
    client: httpx.Client, map_id: str, content: bytes, kind: str = "image/png", **params: str
) -> httpx.Response:
    """What is answered to a floor plan of a map."""
    address, headers = f"/api/maps/{map_id}/floor-plan", {"Content-Type": kind}
    return client.put(address, content=content, headers=headers, params=params)


def plan_of_levels(**sides_m: float) -> str:
    """A GeoJSON plan with a room of that side on each level."""
    rooms = []
    for level, side_m in sides_m.items():
        ring = [[0, 0], [side_m, 0], [side_m, 4], [0, 4], [0, 0]]
        shape = {"type": "Polygon", "coordinates": [ring]}
        rooms.append({"type": "Feature", "properties": {"level": level}, "geometry": shape})
    return json.dumps({"type": "FeatureCollection", "features": rooms})
