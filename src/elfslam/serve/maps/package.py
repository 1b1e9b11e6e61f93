"""A map as phones keep it: parts named by their SHA-256, and a manifest that the server signs."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Any

from sqlalchemy import delete
from sqlalchemy.orm import Session

from elfslam.app.settings import Settings
from elfslam.base.errors import InputError, StoreError
from elfslam.base.parameters import as_dict
from elfslam.base.values import FloorMap, PointOfInterest
from elfslam.data.map_files import ENCODER, MAP, read_map
from elfslam.data.tiles import encoder_identity, stretches_of, tiles_of
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.maps.point_routes import points_of
from elfslam.serve.receiving.completing import scratch
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.sharing.rights import Principal, map_for
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import (
    Map,
    MapFile,
    MapPackage,
    MapPart,
    now_utc,
    reading,
    transaction,
)
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.store.sending import unfolded

FORMAT = 3
GROUPS = ("chirp", "echo", "motion", "locate", "track", "spoofing", "medium_access")
"""The parameters that locating on a phone takes, as far as this version knows them."""
GROUPS_OF_WALK = ("chirp", "echo", "motion", "locate", "closure", "medium_access")
"""Those that drawing a walk on the phone takes while it is recorded."""
NOT_FOR_PHONES = "phones cannot be located in this map"

Json = dict[str, Any]


@dataclass(frozen=True)
class Sources:
    """What a package is made from: the files of a map by name, and what is known beside them."""

    name: str
    files: Mapping[str, Blob]
    floor_plan: Json | None
    parameters: Json
    place: Json = field(default_factory=dict)
    """The venue and the floor, where they are known."""
    points_of_interest: Sequence[PointOfInterest] = ()

    @property
    def sha256(self) -> str:
        """The same as long as nothing changed."""
        files = {name: self.files[name].sha256 for name in (MAP, ENCODER, FLOOR_PLAN)
                 if name in self.files}  # fmt: skip
        told = [FORMAT, self.name, files, self.floor_plan, self.parameters]
        told += [self.place] if self.place else []
        told += [asdict(each) for each in self.points_of_interest]
        return hashlib.sha256(_text(told).encode()).hexdigest()


def package_of(services: Services, asker: Principal, map_id: str) -> str:
    """The manifest of a map that somebody may look at, made anew where something changed since.

    Raises Problem 404, InputError where phones cannot use the map, FileNotFoundError where it was
    deleted meanwhile.
    """
    with reading(services.sessions) as session:
        sources = sources_of(session, map_for(session, asker, map_id), services.settings)
        known = session.get(MapPackage, map_id)
    if known is not None and known.sources_sha256 == sources.sha256:
        return known.manifest
    return _made(services, asker, map_id, sources)


def sources_of(session: Session, found: Map, settings: ServerSettings) -> Sources:
    """What the package of a map is made from."""
    rows = session.query(MapFile).filter_by(map_id=found.id)
    files = {row.name: Blob(row.sha256, row.size_bytes) for row in rows}
    place = {"venue": found.venue, "floor": found.floor}
    known = {name: told for name, told in place.items() if told is not None}
    points = points_of(session, settings, found.id)
    return Sources(found.name, files, found.floor_plan, phone_parameters(), known, points)


def phone_parameters(groups: Collection[str] = GROUPS) -> Json:
    """The groups of parameters that a phone takes, by default those of locating."""
    return {name: group for name, group in as_dict(Settings()).items() if name in groups}


def manifest_of(
    map_id: str, sources: Sources, content: Json, *, revision: int, made_utc: datetime
) -> str:
    """The exact text that is signed."""
    manifest = {
        "format": FORMAT,
        "map": map_id,
        "name": sources.name,
        **sources.place,
        "revision": revision,
        "made_utc": made_utc.isoformat(timespec="seconds"),
        "parameters": sources.parameters,
        **content,
    }
    plan = sources.files.get(FLOOR_PLAN)
    if plan is not None and sources.floor_plan is not None:
        manifest["floor_plan"] = {**_told(plan), **sources.floor_plan}
    if sources.points_of_interest:
        manifest["points_of_interest"] = [asdict(each) for each in sources.points_of_interest]
    return _text(manifest)


def check_encoder(floor_map: FloorMap, encoder: Blob) -> None:
    """Raise InputError where the features of a map were made by another encoder."""
    identity = encoder_identity(floor_map)
    if identity != encoder.sha256[: len(identity)]:
        raise InputError(
            f"{NOT_FOR_PHONES}: made with encoder {identity}, {encoder.sha256[:16]} lies beside it"
        )


def content_of(floor_map: FloorMap, encoder: Blob, kept: Callable[[bytes], Blob]) -> Json:
    """What a manifest says of a map's parts, each of which was `kept`. Raises InputError."""
    return {
        "encoder": {**_told(encoder), "identity": encoder_identity(floor_map)},
        "tiles": [
            {**_told(kept(tile.content)), "spots": tile.spots, "square": list(tile.square)}
            for tile in tiles_of(floor_map)
        ],
        "features": [
            {**_told(kept(each.content)), "spots": each.spots, "walk": each.walk}
            for each in stretches_of(floor_map)
        ],
    }


def _made(services: Services, asker: Principal, map_id: str, sources: Sources) -> str:
    settings = services.settings
    named = {name: sources.files[name].sha256 for name in (MAP, ENCODER) if name in sources.files}
    if len(named) < 2:
        raise InputError(
            f"{NOT_FOR_PHONES}: it has no {MAP if MAP not in named else ENCODER}; "
            "map the walk by its echoes"
        )
    floor_map = _read(settings, {MAP: named[MAP]}, sources.name)
    check_encoder(floor_map, sources.files[ENCODER])
    with scratch(settings) as folder, blobs.locked(settings.blobs_folder):
        parts: dict[str, int] = {}

        def kept(content: bytes) -> Blob:
            file = folder / "part"
            file.write_bytes(content)
            blob = blobs.put(settings.blobs_folder, file)
            file.unlink()
            parts[blob.sha256] = blob.size_bytes
            return blob

        content = content_of(floor_map, sources.files[ENCODER], kept)
        with transaction(services.sessions) as session:
            found = map_for(session, asker, map_id)
            manifest, dropped = _kept(session, found, settings, content, parts)
    drop_unnamed(services, dropped)
    return manifest


def _read(settings: ServerSettings, named: Mapping[str, str], name: str) -> FloorMap:
    with unfolded(settings, named) as folder:
        try:
            return read_map(folder)
        except StoreError as error:
            raise StoreError(str(error).replace(str(folder), name)) from error


def _kept(
    session: Session, found: Map, settings: ServerSettings, content: Json, sizes: Mapping[str, int]
) -> tuple[str, list[str]]:
    """Keep a package beside its map; its manifest, and the SHA-256 of what it names no more."""
    sources, older = sources_of(session, found, settings), session.get(MapPackage, found.id)
    if older is not None and older.sources_sha256 == sources.sha256:
        return older.manifest, []
    # In seconds of this age: it grows even after the folder was put back from a copy.
    revision = max(int(time.time()), 0 if older is None else older.revision + 1)
    manifest = manifest_of(found.id, sources, content, revision=revision, made_utc=now_utc())
    before = [row.sha256 for row in session.query(MapPart).filter_by(map_id=found.id)]
    session.execute(delete(MapPart).where(MapPart.map_id == found.id))
    session.add_all(
        MapPart(map_id=found.id, sha256=sha256, size_bytes=size) for sha256, size in sizes.items()
    )
    session.merge(
        MapPackage(
            map_id=found.id,
            sources_sha256=sources.sha256,
            revision=revision,
            manifest=manifest,
        )
    )
    return manifest, [sha256 for sha256 in before if sha256 not in sizes]


def _told(blob: Blob) -> Json:
    return {"sha256": blob.sha256, "size_bytes": blob.size_bytes}


def _text(told: object) -> str:
    return json.dumps(told, sort_keys=True, ensure_ascii=False, allow_nan=False,
                      separators=(",", ":"))  # fmt: skip
