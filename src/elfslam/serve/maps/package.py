"""A map as phones keep it: parts by their SHA-256, a signed manifest, and its routes."""

import base64
import hashlib
import json
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Any

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel
from sqlalchemy import delete, or_, select, union_all
from sqlalchemy.orm import Session

from elfslam.app.settings import Settings
from elfslam.base.errors import InputError, StoreError
from elfslam.base.parameters import as_dict
from elfslam.base.values import FloorMap, PointOfInterest
from elfslam.data.map_files import ENCODER, MAP, read_map
from elfslam.data.tiles import encoder_identity, stretches_of, tiles_of
from elfslam.serve.buildings.files import published_manifest, published_part
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.maps.places import points_of
from elfslam.serve.network.authority import fingerprint, sign, signing_key, spki_of
from elfslam.serve.people.access import not_found
from elfslam.serve.receiving.completing import scratch
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.settings import ServerSettings
from elfslam.serve.sharing.rights import Asks, Principal, floors_of, map_for
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.store.sending import BINARY, sent_blob, unfolded
from elfslam.serve.store.tables import Map, MapFile, MapPackage, MapPart, now_utc

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
    """The venue and the floor, where they are known, and of a building what joins its floors."""
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
    known: Json = {name: told for name, told in place.items() if told is not None}
    if "level" in found.facts:
        known |= _joined(session, found)
    points = points_of(session, settings, found.id)
    return Sources(found.name, files, found.floor_plan, phone_parameters(), known, points)


def _joined(session: Session, found: Map) -> Json:
    """The level of a map, the passages that touch it, and its owner's maps of the other floors."""
    floors = floors_of(session, Principal(found.user_id), found)
    others = [
        {"level": each.facts["level"], "map": each.id} for each in floors if each is not found
    ]
    passages = found.facts.get("passages", [])
    return {"level": found.facts["level"], "passages": passages, "floors": others}


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
        manifest["floor_plan"] = {**asdict(plan), **sources.floor_plan}
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
        "encoder": {**asdict(encoder), "identity": encoder_identity(floor_map)},
        "tiles": [
            {**asdict(kept(tile.content)), "spots": tile.spots, "square": list(tile.square)}
            for tile in tiles_of(floor_map)
        ],
        "features": [
            {**asdict(kept(each.content)), "spots": each.spots, "walk": each.walk}
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
            map_id=found.id, sources_sha256=sources.sha256, revision=revision, manifest=manifest
        )
    )
    return manifest, [sha256 for sha256 in before if sha256 not in sizes]


def _text(told: object) -> str:
    return json.dumps(told, sort_keys=True, ensure_ascii=False, allow_nan=False,
                      separators=(",", ":"))  # fmt: skip


router = APIRouter(tags=["packages"])
public = APIRouter(tags=["packages"])
"""The key is no secret, and who has nothing but a link needs it."""


class KeyBody(BaseModel):
    """The public key (SPKI, base64) and its SHA-256 (base64url) as pairing addresses carry it."""

    spki: str
    key: str


class PackageBody(BaseModel):
    """The exact text of a manifest, and its signature: ECDSA P-256 SHA-256, r and s, base64."""

    manifest: str
    signature: str


@public.get("/key", operation_id="get_key")
def get_key(services: ServicesDep) -> KeyBody:
    """The key that signs map packages. Trust it only if its SHA-256 is the one of your address."""
    key = signing_key(services.settings.authority_folder)
    return KeyBody(spki=base64.b64encode(spki_of(key)).decode(), key=fingerprint(key))


@router.get("/maps/{map_id}/package", operation_id="get_package")
def get_package(map_id: str, asker: Asks, services: ServicesDep) -> PackageBody:
    """What a phone needs to locate in a map, by digests; the phone fetches the parts it lacks."""
    try:
        manifest = published_manifest(services, map_id) or package_of(services, asker, map_id)
    except FileNotFoundError as error:
        raise not_found("map") from error
    key = signing_key(services.settings.authority_folder)
    signature = base64.b64encode(sign(key, manifest.encode())).decode()
    return PackageBody(manifest=manifest, signature=signature)


@router.get(
    "/maps/{map_id}/package/{sha256}",
    operation_id="get_package_part",
    response_class=FileResponse,
    responses={200: {"content": {BINARY: {}}}},
)
def get_package_part(map_id: str, sha256: str, asker: Asks, services: ServicesDep) -> Response:
    """A tile, the encoder, or the floor plan of a map's package."""
    headers = {"ETag": f'"{sha256}"'}
    content = published_part(services, map_id, sha256)
    if content is not None:
        return Response(content, media_type=BINARY, headers=headers)
    files = select(MapFile.sha256).where(
        MapFile.map_id == map_id, or_(MapFile.name == ENCODER, MapFile.name == FLOOR_PLAN)
    )
    parts = union_all(files, select(MapPart.sha256).where(MapPart.map_id == map_id))
    with reading(services.sessions) as session:
        map_for(session, asker, map_id)
        if sha256 not in session.scalars(parts).all():
            raise not_found("part of this map")
    return sent_blob(services.settings, sha256, "part of this map", BINARY, headers=headers)
