"""Points of interest: places on a map that have a name."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class PointKind(StrEnum):
    """What is at a point of interest."""

    ROOM = "room"
    DOOR = "door"
    STAIRS = "stairs"
    LIFT = "lift"
    OTHER = "other"


@dataclass(frozen=True)
class PointOfInterest:
    """A place with a name, in the plane of its map."""

    name: str
    kind: PointKind
    x_m: float
    y_m: float
