"""A building: floors above each other in one frame, and the passages that join them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.values import LevelPassage, Levels

FARTHEST_LEVEL = 200
"""No building has more floors above its entrance, or below it."""
MOST_PASSAGES = 1_000
LONGEST_RIDE_S = 3_600.0


@dataclass(frozen=True)
class BuildingFloor:
    """A floor: its ordinal, 0 at the entrance, and its height over floor 0."""

    level: int
    height_m: float


@dataclass(frozen=True, eq=False)
class FloorsVisited:
    """When a walk was on which floor, and those floors in rising order."""

    levels: Levels
    floors: tuple[BuildingFloor, ...]


@dataclass(frozen=True)
class Passage:
    """What leads from one floor to another: where it is entered, where left, and how long it takes.

    Stairs and lifts lead both ways, an escalator only from `from_level` to `to_level`. Positions
    are x and y in the frame that all floors share.
    """

    kind: LevelPassage
    from_level: int
    to_level: int
    from_xy_m: tuple[float, float]
    to_xy_m: tuple[float, float]
    duration_s: float


@dataclass(frozen=True)
class Building:
    """Floors in rising order, and passages between them. Raises InputError for any other."""

    name: str
    floors: tuple[BuildingFloor, ...]
    passages: tuple[Passage, ...] = ()

    def __post_init__(self) -> None:
        levels = [each.level for each in self.floors]
        heights = [each.height_m for each in self.floors]
        if not levels or any(one >= other for one, other in pairwise(levels)):
            raise InputError(f"building: floors are {levels}, wanted one or more, in rising order")
        if max(map(abs, levels)) > FARTHEST_LEVEL or not all(abs(h) <= FARTHEST_M for h in heights):
            raise InputError(
                f"building: levels {levels[0]} to {levels[-1]} at {heights[0]:g} to "
                f"{heights[-1]:g} m, wanted at most {FARTHEST_LEVEL} from 0; correct them"
            )
        if any(one >= other for one, other in pairwise(heights)):
            raise InputError(f"building: heights are {heights} m, wanted them rising; correct them")
        if len(self.passages) > MOST_PASSAGES:
            raise InputError(f"building: wanted at most {MOST_PASSAGES} passages; leave some out")
        for each in self.passages:
            _check_passage(each, levels)

    @property
    def levels(self) -> tuple[int, ...]:
        """The ordinals of the floors, rising."""
        return tuple(each.level for each in self.floors)

    def passages_at(self, level: int) -> tuple[Passage, ...]:
        """The passages that lead to a floor or away from it."""
        return tuple(each for each in self.passages if level in (each.from_level, each.to_level))


def _check_passage(passage: Passage, levels: Sequence[int]) -> None:
    ends = passage.from_level, passage.to_level
    if ends[0] == ends[1] or not set(ends) <= set(levels):
        raise InputError(
            f"building: {passage.kind} leads from level {ends[0]} to {ends[1]}, wanted two of "
            f"{', '.join(map(str, levels))}; correct it"
        )
    metres = [*passage.from_xy_m, *passage.to_xy_m]
    lasting = 0 <= passage.duration_s <= LONGEST_RIDE_S
    if not (lasting and all(abs(m) <= FARTHEST_M and math.isfinite(m) for m in metres)):
        raise InputError(
            f"building: {passage.kind} from level {ends[0]} is at {metres} m for "
            f"{passage.duration_s:g} s, wanted finite metres and up to {LONGEST_RIDE_S:g} s"
        )
