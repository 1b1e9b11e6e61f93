"""The demonstration building: simulated maps, to be looked at before anybody has walked.

`demonstration.zip` beside this module holds a folder for each map and `maps.json`, which says what
each is. `python -m studies.demonstration` makes it.
"""

import json
import secrets
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fastapi import APIRouter
from sqlalchemy import select
from sqlalchemy.orm import Session

from elfslam.base.zips import unpack_zip
from elfslam.data.map_files import ENCODER
from elfslam.serve.jobs.routes import refuse_full
from elfslam.serve.maps.bodies import MapBody, bodies_of
from elfslam.serve.people.access import Me, not_found
from elfslam.serve.problems import Problem, problems
from elfslam.serve.receiving.completing import scratch
from elfslam.serve.services import ServicesDep
from elfslam.serve.sharing.rights import Principal
from elfslam.serve.sharing.routes import SECRET_BYTES
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import drop_unnamed, forget_maps
from elfslam.serve.store.tables import Map, MapFile, MapLink, new_id
from elfslam.stages.feature import SHIPPED_ENCODER

router = APIRouter(tags=["maps"], prefix="/demonstration")
FILE = Path(__file__).with_suffix(".zip")
MAPS = "maps.json"
MARK = "demonstration"


@router.post("", status_code=201, operation_id="load_demonstration", responses=problems(409))
def load_demonstration(user: Me, services: ServicesDep) -> list[MapBody]:
    """Put the demonstration building among your maps: a map a floor, and a walk to be merged."""
    with reading(services.sessions) as session:
        refuse_full(services, session, user.id)
        if _loaded(session, user.id):
            raise Problem(409, "the demonstration building is there already; look among the maps")
    with scratch(services.settings) as folder:
        unpack_zip(FILE, folder)
        told = json.loads((folder / MAPS).read_text(encoding="utf-8"))
        ids = {each["folder"]: new_id() for each in told}
        for name in ids:
            shutil.copyfile(SHIPPED_ENCODER, folder / name / ENCODER)
        with blobs.locked(services.settings.blobs_folder):
            files = {
                name: blobs.put_folder(services.settings.blobs_folder, folder / name)
                for name in ids
            }
            with transaction(services.sessions) as session:
                for each in told:
                    _add(session, user.id, each, ids, files[each["folder"]])
    with reading(services.sessions) as session:
        return bodies_of(session, Principal(user.id), Map.id.in_(ids.values()))


@router.delete("", status_code=204, operation_id="remove_demonstration")
def remove_demonstration(user: Me, services: ServicesDep) -> None:
    """Take the demonstration building away, with everything that was merged of it alone."""
    with transaction(services.sessions) as session:
        ids = _loaded(session, user.id)
        if not ids:
            raise not_found("demonstration building")
        named = forget_maps(session, ids)
    drop_unnamed(services, named)


def _loaded(session: Session, user_id: str) -> list[str]:
    """The maps of the demonstration that a user has."""
    maps = session.scalars(select(Map).where(Map.user_id == user_id))
    return [each.id for each in maps if MARK in each.facts]


def _add(
    session: Session,
    user_id: str,
    told: Mapping[str, Any],
    ids: Mapping[str, str],
    files: Mapping[str, Blob],
) -> None:
    """A map of the demonstration; one that is `shared` has a link."""
    facts = {**told["facts"], MARK: True}
    if "frame" in facts:
        facts["frame"] = ids[facts["frame"]]
    row = {name: told[name] for name in ("name", "kind", "venue", "floor", "floor_plan")}
    map_id = ids[told["folder"]]
    session.add(Map(id=map_id, user_id=user_id, facts=facts, **row))
    session.flush()
    session.add_all(
        MapFile(map_id=map_id, name=name, **asdict(blob)) for name, blob in files.items()
    )
    if told["shared"]:
        secret = secrets.token_urlsafe(SECRET_BYTES)
        session.add(MapLink(map_id=map_id, secret=secret, may="read"))
