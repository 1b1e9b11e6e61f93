"""Maps and recordings of a server, put where jobs and uploads would have left them."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import select

from elfslam.base.values import FloorMap
from elfslam.data.map_files import ENCODER, MAP, write_map
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Map, MapFile, Recording, RecordingFile, User
from elfslam.stages.feature import OnnxEncoder, load_encoder


def plant_files(services: Services, row: Map | Recording, folder: Path) -> str:
    """A row, new or known, and all that lies in a folder as its files; gives the row's id."""
    store = services.settings.blobs_folder
    with blobs.locked(store), transaction(services.sessions) as session:
        session.add(row)
        session.flush()
        for name, blob in blobs.put_folder(store, folder).items():
            told = {"name": name, "sha256": blob.sha256, "size_bytes": blob.size_bytes}
            if isinstance(row, Map):
                session.merge(MapFile(map_id=row.id, **told))
            else:
                session.merge(RecordingFile(recording_id=row.id, **told))
        return row.id


def plant_floor_map(
    services: Services,
    floor_map: FloorMap,
    folder: Path,
    map_id: str | None = None,
    encoder: bytes | None = None,
) -> str:
    """A map of the owner's, or another content of one; `folder` is to be empty. Gives the id."""
    write_map(floor_map, folder / MAP)
    shipped = load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    (folder / ENCODER).write_bytes(encoder or shipped.content)
    with reading(services.sessions) as session:
        owner = session.scalars(select(User).filter_by(is_owner=True)).one()
        row = session.get(Map, map_id or "")
    return plant_files(services, row or Map(user_id=owner.id, name="Hall", kind="run"), folder)
