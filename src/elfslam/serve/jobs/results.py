"""What a job made becomes a map, or fixes: all files first, then all rows at once.

Whoever is killed in between leaves files that nobody names; the next start sweeps them away. A new
map has the floor plan of the map whose frame it has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from sqlalchemy.orm import Session

from elfslam.data.map_files import BY_TAPS, MISSING
from elfslam.serve.jobs.executors import OUT, Result
from elfslam.serve.jobs.queue import Claim, finish
from elfslam.serve.jobs.tasks import FLOOR, FLOOR_PLAN, RUN, frame_of, maps_to_merge, name_of
from elfslam.serve.services import Services
from elfslam.serve.sharing.rights import Principal, Right, right_in
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import transaction
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.store.tables import JobFile, JobKind, Map, MapFacts, MapFile, Recording, new_id

JOINED = " + "
MOST_NAME = 120


def keep(services: Services, held: Claim, folder: Path, result: Result) -> bool:
    """Keep what lies in a job's folder and end the job; whether the claim still held.

    A job may fail and yet leave something: dead reckoning where no loop closed, say.
    """
    store = services.settings.blobs_folder
    made: dict[str, Blob] = {}
    with blobs.locked(store):
        if result.facts is not None:
            made = blobs.put_folder(store, folder / OUT)
        with transaction(services.sessions) as session:
            gave, map_id = _gave(held, result)
            kept = finish(session, held, gave, result.problem)
            if kept and map_id is not None and result.facts is not None:
                _add_map(session, held, map_id, cast(MapFacts, result.facts), made)
            elif kept:
                _add_files(session, held, made)
    if not kept:
        drop_unnamed(services, [blob.sha256 for blob in made.values()])
    return kept


def _gave(held: Claim, result: Result) -> tuple[dict[str, Any], str | None]:
    """What the job says that it gave, and the id of its map where it gives one."""
    if result.facts is None:
        return {}, None
    if held.kind is JobKind.LOCATE:
        return {"fixes": held.job_id, **result.facts}, None
    map_id = new_id()
    lacked = {MISSING: result.facts[MISSING]} if result.facts.get(MISSING) else {}
    return {"map": map_id, **lacked}, map_id


def _add_map(
    session: Session, held: Claim, map_id: str, facts: MapFacts, made: dict[str, Blob]
) -> None:
    kind = RUN if held.kind is JobKind.MAP else FLOOR
    told = _origin(session, held)
    added = Map(id=map_id, user_id=held.user_id, kind=kind, facts=facts, **told)
    session.add(added)
    session.flush()
    if held.kind is JobKind.MAP:
        recording = session.get_one(Recording, held.given["recording"])
        lay_on_tapped_plan(session, added, recording, facts)
    else:
        lay_on_plan_of_first(session, added, maps_to_merge(session, held), facts)
    session.add_all(
        MapFile(map_id=map_id, name=name, **asdict(blob)) for name, blob in made.items()
    )


def _add_files(session: Session, held: Claim, made: dict[str, Blob]) -> None:
    session.add_all(
        JobFile(job_id=held.job_id, name=name, **asdict(blob)) for name, blob in made.items()
    )


def _origin(session: Session, held: Claim) -> dict[str, Any]:
    """The name of a map, the recordings that it came from, each once, and where it lies.

    What a claim works on is there as long as the claim holds: deleting it ends the job.
    """
    if held.kind is JobKind.MAP:
        recording = session.get_one(Recording, held.given["recording"])
        return {"name": recording.name, "sources": [recording.id]}
    maps = maps_to_merge(session, held)
    named = held.given.get("name") or JOINED.join(each.name for each in maps)[:MOST_NAME]
    sources = list(dict.fromkeys(source for each in maps for source in each.sources))
    return {"name": named, "sources": sources, **_common_place(maps)}


def _common_place(maps: Sequence[Map]) -> dict[str, str | None]:
    """The venue and floor of maps that all lie there."""
    venues, floors = {each.venue for each in maps}, {(each.venue, each.floor) for each in maps}
    venue = venues.pop() if len(venues) == 1 else None
    return {"venue": venue, "floor": floors.pop()[1] if len(floors) == 1 else None}


def lay_on_tapped_plan(session: Session, made: Map, recording: Recording, facts: MapFacts) -> None:
    """Give the map of a walk the plan, venue and floor of the map on which its walker tapped.

    Both have one frame, where mapping found the walk there. Nothing is given where that map is
    gone, or where its walker may no longer look at it.
    """
    if facts.get("heading") != BY_TAPS:
        return
    tapped = session.get(Map, recording.facts.get("tapped_on", ""))
    if tapped is None or right_in(session, Principal(made.user_id), tapped) < Right.READ:
        return
    made.venue, made.floor = tapped.venue, tapped.floor
    _lay(session, made, tapped)


def lay_on_plan_of_first(session: Session, made: Map, maps: Sequence[Map], facts: MapFacts) -> None:
    """Give a merged map the plan of the map whose frame it has, and note that frame.

    That is the merged one among them, else the oldest walk that was not refused.
    """
    inside = [each for each in maps if name_of(each) not in facts.get("refused", {})]
    inside.sort(key=lambda each: each.kind != FLOOR)
    if inside:
        made.facts = {**made.facts, "frame": frame_of(session, inside[0])}
        _lay(session, made, inside[0])


def _lay(session: Session, made: Map, planned: Map) -> None:
    plan = session.get(MapFile, (planned.id, FLOOR_PLAN))
    if plan is None:
        return
    made.floor_plan = planned.floor_plan
    told = {"name": plan.name, "sha256": plan.sha256, "size_bytes": plan.size_bytes}
    session.add(MapFile(map_id=made.id, **told))
