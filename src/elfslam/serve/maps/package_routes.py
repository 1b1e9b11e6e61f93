"""Routes of what phones keep: the signed manifest of a map, its parts, and the server's key."""

from __future__ import annotations

import base64

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel
from sqlalchemy import or_, select, union_all

from elfslam.data.map_files import ENCODER
from elfslam.serve.buildings.fetching import published_manifest, published_part
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.maps.package import package_of
from elfslam.serve.network.signing import fingerprint, sign, signing_key, spki_of
from elfslam.serve.people.access import not_found
from elfslam.serve.services import ServicesDep
from elfslam.serve.sharing.rights import Asks, map_for
from elfslam.serve.store.database import MapFile, MapPart, reading
from elfslam.serve.store.sending import sent_blob

router = APIRouter(tags=["packages"])
public = APIRouter(tags=["packages"])
"""The key is no secret, and who has nothing but a link needs it."""
BINARY = "application/octet-stream"


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
