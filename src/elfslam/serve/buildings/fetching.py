"""What phones fetch of a published floor: its manifest and its parts, as of maps of their own."""

from __future__ import annotations

from sqlalchemy import select

from elfslam.serve.buildings import files as store
from elfslam.serve.buildings.tables import Floor, FloorPart
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading


def published_manifest(services: Services, map_id: str) -> str | None:
    """The manifest of a floor by the id of its map; None where there is no such floor."""
    with reading(services.sessions) as session:
        return session.scalar(select(Floor.manifest).filter_by(id=map_id))


def published_part(services: Services, map_id: str, sha256: str) -> bytes | None:
    """A part of a floor's package; None where that has no such part. Raises StoreError."""
    wanted = select(FloorPart.sha256).join(Floor).where(Floor.id == map_id)
    with reading(services.sessions) as session:
        named = session.scalar(wanted.where(FloorPart.sha256 == sha256))
    if named is None:
        return None
    try:
        return store.read(store.open_files(services.settings), named)
    except FileNotFoundError:
        return None
