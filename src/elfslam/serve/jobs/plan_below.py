"""The floor plan below a new map: that of the map whose frame it has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy.orm import Session

from elfslam.data.map_files import BY_TAPS
from elfslam.serve.jobs.tasks import FLOOR, FLOOR_PLAN, FRAME, frame_of, name_of
from elfslam.serve.sharing.rights import Principal, Right, right_in
from elfslam.serve.store.database import Map, MapFile, Recording


def lay_on_tapped_plan(
    session: Session, made: Map, recording: Recording, facts: dict[str, Any]
) -> None:
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


def lay_on_plan_of_first(
    session: Session, made: Map, maps: Sequence[Map], facts: dict[str, Any]
) -> None:
    """Give a merged map the plan of the map whose frame it has, and note that frame.

    That is the merged one among them, else the oldest walk that was not refused.
    """
    inside = [each for each in maps if name_of(each) not in facts.get("refused", {})]
    inside.sort(key=lambda each: each.kind != FLOOR)
    if inside:
        made.facts = {**made.facts, FRAME: frame_of(session, inside[0])}
        _lay(session, made, inside[0])


def _lay(session: Session, made: Map, planned: Map) -> None:
    plan = session.get(MapFile, (planned.id, FLOOR_PLAN))
    if plan is None:
        return
    made.floor_plan = planned.floor_plan
    told = {"name": plan.name, "sha256": plan.sha256, "size_bytes": plan.size_bytes}
    session.add(MapFile(map_id=made.id, **told))
