"""Walks over several floors become one building: their floors numbered alike, their maps apart."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.building import Building, BuildingFloor, FloorsVisited
from elfslam.base.errors import InputError
from elfslam.base.values import FloorMap, Trajectory
from elfslam.slam.floors import gathered_passages, passages_walked
from elfslam.slam.front_end import floors_walked
from elfslam.slam.merging.grow import map_of_walks, pair_alignment
from elfslam.slam.merging.members import MappedWalk, MergeParameters, links_between, side_of

Floors = tuple[BuildingFloor, ...]


@dataclass(frozen=True, eq=False)
class MergedFloor:
    """The map of one floor, and the walks on it: their trajectories there, by name."""

    floor_map: FloorMap
    trajectories: dict[str, Trajectory]


def numbered_alike(
    walks: Sequence[MappedWalk], floors: Sequence[Floors], parameters: MergeParameters
) -> tuple[list[MappedWalk], list[Floors]]:
    """The walks with their levels counted as the first walk's are, and so their floors.

    Each walk counts from the floor that it began on. Of the ways to count that put floors of equal
    heights on each other, that one is right whose floors are most similar. Raises InputError where
    the heights of a walk fit in no way.
    """
    first = side_of(walks[0], parameters)
    alike, numbered = [walks[0]], [floors[0]]
    for walk, own in zip(walks[1:], floors[1:], strict=True):
        assert walk.levels is not None
        shifts = [k for k in _shifts(floors[0], own) if _fits(floors[0], own, k, parameters)]
        if not shifts:
            raise InputError(
                f"merge: {walk.name} has floors at {_heights(own)} m, {walks[0].name} at "
                f"{_heights(floors[0])} m, wanted two or more of equal heights; merge it alone"
            )
        moved = [
            replace(walk, levels=replace(walk.levels, level=walk.levels.level + k)) for k in shifts
        ]
        evidence = []
        for each in moved:
            side = side_of(each, parameters)
            links = links_between(first, side, parameters)
            evidence.append(pair_alignment(first, side, links, parameters).evidence)
        best = int(np.argmax(evidence))
        alike.append(moved[best])
        numbered.append(tuple(replace(each, level=each.level + shifts[best]) for each in own))
    return alike, numbered


def _shifts(one: Floors, other: Floors) -> list[int]:
    """By how many floors the levels of another walk may be moved, the fewest first."""
    every = range(one[0].level - other[-1].level, one[-1].level - other[0].level + 1)
    return sorted(every, key=abs)


def _fits(one: Floors, other: Floors, shift: int, parameters: MergeParameters) -> bool:
    """Whether two floors or more then lie on such that are as high over each other."""
    heights_m = {each.level: each.height_m for each in one}
    shared = [each for each in other if each.level + shift in heights_m]
    off_m = [each.height_m - heights_m[each.level + shift] for each in shared]
    return len(shared) > 1 and float(np.ptp(off_m)) < parameters.levels.same_floor_m


def _heights(floors: Floors) -> str:
    return ", ".join(f"{each.height_m:g}" for each in floors)


def merged_floors(
    walks: Sequence[MappedWalk],
    trajectories: Sequence[Trajectory],
    floors: Sequence[Floors],
    parameters: MergeParameters,
) -> dict[int, MergedFloor]:
    """The floors of walks that share a frame, by level, each mapped by those who walked on it."""
    parts: dict[int, list[tuple[MappedWalk, Trajectory]]] = {}
    for walk, trajectory, own in zip(walks, trajectories, floors, strict=True):
        assert walk.levels is not None
        level = walk.levels.at(trajectory.t_s)
        heard = walk.levels.at(walk.features.t_s)
        for floor in floors_walked(FloorsVisited(walk.levels, own), trajectory.t_s):
            there = trajectory.chosen(level == floor)
            part = replace(walk, features=walk.features.chosen(heard == floor))
            parts.setdefault(floor, []).append((part, there))
    return {floor: _merged_floor(some, parameters) for floor, some in sorted(parts.items())}


def _merged_floor(
    parts: Sequence[tuple[MappedWalk, Trajectory]], parameters: MergeParameters
) -> MergedFloor:
    walks, trajectories = [walk for walk, _ in parts], [trajectory for _, trajectory in parts]
    names = [walk.name for walk in walks]
    floor_map = map_of_walks(walks, trajectories, parameters)
    return MergedFloor(floor_map, dict(zip(names, trajectories, strict=True)))


def merged_building(
    name: str,
    walks: Sequence[MappedWalk],
    trajectories: Sequence[Trajectory],
    floors: Sequence[Floors],
    levels: Sequence[int],
) -> Building:
    """The building of walks that are numbered alike: mean heights, and the passages of them all."""
    known = {each.level: each.height_m for each in floors[0]}
    offsets_m = [
        float(np.mean([known[each.level] - each.height_m for each in own if each.level in known]))
        for own in floors
    ]
    found: dict[int, list[float]] = {level: [] for level in levels}
    for own, offset_m in zip(floors, offsets_m, strict=True):
        for each in own:
            if each.level in found:
                found[each.level].append(each.height_m + offset_m)
    walked = [
        passage
        for walk, trajectory, own in zip(walks, trajectories, floors, strict=True)
        if walk.levels is not None
        for passage in passages_walked(trajectory, FloorsVisited(walk.levels, own))
        if {passage.from_level, passage.to_level} <= set(levels)
    ]
    heights_m = {level: float(np.mean(each)) for level, each in found.items()}
    ground_m = heights_m.get(0, 0.0)
    there = tuple(BuildingFloor(k, round(m - ground_m, 2)) for k, m in heights_m.items())
    return Building(name, there, gathered_passages(walked))
