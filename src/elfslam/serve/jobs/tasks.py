"""What a job is to work on, laid out as files: recordings and maps by name, and the task."""

import json
import re
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from elfslam.base.errors import InputError
from elfslam.data.map_files import BY_TAPS, MAP
from elfslam.serve.jobs.executors import GIVEN, TASK
from elfslam.serve.jobs.queue import Claim
from elfslam.serve.services import Services
from elfslam.serve.sharing.rights import Principal, Right, floors_of, right_in
from elfslam.serve.store import blobs
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import JobKind, Map, MapFile, Recording, RecordingFile
from elfslam.serve.texts import as_file_name

RUN, FLOOR = "run", "floor"
"""Kinds of maps: of one walk, or merged."""
FLOOR_PLAN = "floor-plan"
"""The one file of a map that is not part of its folder."""
UNSAFE = re.compile(r"[^\w\- ]+")
ID_CHARACTERS = 6

Named = dict[str, str]
"""SHA-256 by the name of a file."""
Task = tuple[dict[str, Any], dict[str, Named]]
"""What is to be done, and the folders that it needs by name."""


def lay_out(services: Services, held: Claim, folder: Path) -> None:
    """Fill a job's folder. Raises InputError where what it works on is gone, OSError."""
    limits = services.settings.limits
    with reading(services.sessions) as session:
        task, folders = TASKS[held.kind](session, held)
    for name, named in folders.items():
        try:
            blobs.link_into(folder / GIVEN / name, services.settings.blobs_folder, named)
        except FileNotFoundError as cause:
            raise gone(name) from cause
    told = {**task, "kind": held.kind, "limits": {"bytes": limits.job_bytes}}
    (folder / TASK).write_text(json.dumps(told), encoding="utf-8")


def folder_of_map(session: Session, map_id: str) -> Named:
    """The files of a map's folder."""
    rows = select(MapFile.name, MapFile.sha256).where(
        MapFile.map_id == map_id, MapFile.name != FLOOR_PLAN
    )
    return {row.name: row.sha256 for row in session.execute(rows)}


def maps_to_merge(session: Session, held: Claim) -> list[Map]:
    """In the order in which they were walked: the first gives the frame."""
    maps = [_existing(session, map_id) for map_id in held.given["maps"]]
    return sorted(maps, key=lambda each: (_walked(session, each), each.id))


def file_name(text: str) -> str:
    """A name for people as the name of a file, on any system."""
    return as_file_name(UNSAFE.sub("_", text).strip(" _")).strip() or "unnamed"


def gone(what: str) -> InputError:
    """The refusal of a job whose input was deleted."""
    return InputError(f"{what} was deleted; make a new job of what is there")


def _map(session: Session, held: Claim) -> Task:
    name, named = _recording(session, held.given["recording"])
    asked = {each: held.given.get(each) for each in ("start_pose", "from_s", "until_s")}
    return {"recording": name, "by": held.given.get("by") or [], **asked}, {name: named}


def _merge(session: Session, held: Claim) -> Task:
    maps = [_still(session, held, each, Right.EDIT) for each in maps_to_merge(session, held)]
    folders = {name_of(each): folder_of_map(session, each.id) for each in maps}
    frames = {frame_of(session, each) for each in maps}
    return {"maps": list(folders), "known_starts": len(frames) == 1}, folders


def _locate(session: Session, held: Claim) -> Task:
    name, named = _recording(session, held.given["recording"])
    place = _still(session, held, _existing(session, held.given["map"]), Right.READ)
    floors = floors_of(session, Principal(held.user_id), place)
    folders = {name_of(each): folder_of_map(session, each.id) for each in floors}
    levels = {str(each.facts.get("level", 0)): name_of(each)
              for each in floors if each is place or MAP in folders[name_of(each)]}  # fmt: skip
    told = {"recording": name, "map": name_of(place), "floors": levels, "place": place.name}
    return {**told, "mode": held.given["mode"]}, {name: named, **folders}


TASKS: Mapping[JobKind, Callable[[Session, Claim], Task]] = {
    JobKind.MAP: _map,
    JobKind.MERGE: _merge,
    JobKind.LOCATE: _locate,
}


def _recording(session: Session, recording_id: str) -> tuple[str, Named]:
    recording = session.get(Recording, recording_id)
    if recording is None:
        raise gone("the recording")
    rows = select(RecordingFile.name, RecordingFile.sha256).filter_by(recording_id=recording_id)
    return file_name(recording.name), {row.name: row.sha256 for row in session.execute(rows)}


def _existing(session: Session, map_id: str) -> Map:
    found = session.get(Map, map_id)
    if found is None:
        raise gone("a map")
    return found


def _still(session: Session, held: Claim, found: Map, wanted: Right) -> Map:
    """A map that whoever queued the job has not lost the right to since."""
    if right_in(session, Principal(held.user_id), found) < wanted:
        raise InputError("a map of this job is shared with you no more; ask its owner")
    return found


def frame_of(session: Session, each: Map) -> str:
    """The id of the map whose frame this one has: its own, that of the map tapped on, or that of
    the first of the maps that it was merged from."""
    if each.kind == FLOOR or "level" in each.facts:
        return str(each.facts.get("frame", each.id))
    if each.facts.get("heading") != BY_TAPS:
        return each.id
    recording = session.get(Recording, each.sources[0])
    frame = each.id if recording is None else str(recording.facts.get("tapped_on", each.id))
    tapped = session.get(Map, frame) if frame != each.id else None
    return frame if tapped is None else frame_of(session, tapped)


def name_of(each: Map) -> str:
    """Two walks of one name are told apart, and one walk is known again wherever it is merged."""
    return f"{file_name(each.name)}-{each.id[:ID_CHARACTERS]}"


def _walked(session: Session, each: Map) -> datetime:
    """When the oldest recording of a map began to come in, or else when the map was made."""
    times = select(Recording.created_utc).where(Recording.id.in_(each.sources))
    return min(session.scalars(times), default=each.created_utc)
