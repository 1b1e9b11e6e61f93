"""The floor plan that a walker tapped on lies below the map of the walk."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from elfslam.app.map import BY_TAPS
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.sharing.rights import Asker, Right, right_in
from elfslam.serve.store.database import Map, MapFile, Recording


def lay_on_tapped_plan(
    session: Session, made: Map, recording: Recording, facts: dict[str, Any]
) -> None:
    """Give a new map the plan, venue and floor of the map on which its walker tapped.

    Both have one frame, where mapping found the walk there. Nothing is given where that map is
    gone, or where its walker may no longer look at it.
    """
    if facts.get("heading") != BY_TAPS:
        return
    tapped = session.get(Map, recording.facts.get("tapped_on", ""))
    if tapped is None or right_in(session, Asker(made.user_id), tapped) < Right.READ:
        return
    made.venue, made.floor = tapped.venue, tapped.floor
    plan = session.get(MapFile, (tapped.id, FLOOR_PLAN))
    if plan is not None:
        made.floor_plan = tapped.floor_plan
        session.add(
            MapFile(map_id=made.id, name=plan.name, sha256=plan.sha256, size_bytes=plan.size_bytes)
        )
