"""Walks over several floors become one building: their floors numbered alike, their maps apart."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.building import Building, BuildingFloor, FloorsVisited
from elfslam.base.errors import InputError
from elfslam.base.values import FloorMap, Levels, Trajectory
from elfslam.slam.floors import gathered_passages, passages_walked
from elfslam.slam.front_end import floors_walked
from elfslam.slam.merging.forgetting import renewed
from elfslam.slam.merging.grow import (
    aligned_onto,
    alignment_by,
    check_map_encoder,
    laid_onto,
    map_of,
    map_of_walks,
    met,
    pair_alignment,
)
from elfslam.slam.merging.members import (
    MappedWalk,
    MergeParameters,
    links_between,
    side_of,
    sides_of,
)
from elfslam.stages.map_alignment import Registration

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
        possible = _numberings(walks[0].name, floors[0], walk, own, parameters)
        evidence = []
        for each, _ in possible:
            side = side_of(each, parameters)
            links = links_between(first, side, parameters)
            evidence.append(pair_alignment(first, side, links, parameters).evidence)
        best, there = possible[int(np.argmax(evidence))]
        alike.append(best)
        numbered.append(there)
    return alike, numbered


def _numberings(
    name: str, known: Floors, walk: MappedWalk, own: Floors, parameters: MergeParameters
) -> list[tuple[MappedWalk, Floors]]:
    """The ways to count a walk's floors as those of a building are; one floor may be any of them.

    Raises InputError where there is none.
    """
    if walk.levels is None:
        begin_s = walk.trajectory.t_s[:1]
        return [
            (replace(walk, levels=Levels(begin_s, np.array([float(each.level)]), (None,))), (each,))
            for each in known
        ]
    shifts = [k for k in _shifts(known, own) if _fits(known, own, k, parameters)]
    if not shifts:
        raise InputError(
            f"merge: {walk.name} has floors at {_heights(own)} m, {name} at {_heights(known)} m, "
            "wanted two or more of equal heights; merge it alone"
        )
    return [
        (
            replace(walk, levels=replace(walk.levels, level=walk.levels.level + k)),
            tuple(replace(each, level=each.level + k) for each in own),
        )
        for k in shifts
    ]


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
        for floor, part in _parts(walk, trajectory, own).items():
            parts.setdefault(floor, []).append(part)
    return {floor: _merged_floor(some, parameters) for floor, some in sorted(parts.items())}


def _parts(
    walk: MappedWalk, trajectory: Trajectory, own: Floors
) -> dict[int, tuple[MappedWalk, Trajectory]]:
    """A walk in parts, by the level of each floor that it went on."""
    assert walk.levels is not None
    level, heard = walk.levels.at(trajectory.t_s), walk.levels.at(walk.features.t_s)
    return {
        floor: (
            replace(walk, features=walk.features.chosen(heard == floor)),
            trajectory.chosen(level == floor),
        )
        for floor in floors_walked(FloorsVisited(walk.levels, own), trajectory.t_s)
    }


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


def add_to_building(
    building: Building,
    maps: Mapping[int, FloorMap],
    walk: MappedWalk,
    own: Floors,
    parameters: MergeParameters,
    *,
    known_start: bool = False,
) -> tuple[Building, dict[int, MergedFloor], Registration, Floors]:
    """A building whose floors have maps, by level, with one more walk, if it belongs there.

    One alignment serves all floors; a walk of one floor may be on any. Gives the maps of the floors
    that the walk went on, with its trajectory there, none where the alignment says why not; and
    its floors as the building counts them. Raises InputError where encoders or heights differ.
    """
    check_map_encoder(next(iter(maps.values())), walk)
    ones = [
        replace(side, level=np.full(len(side.poses), float(level)))
        for level, each in maps.items()
        for side in sides_of(each, parameters)
    ]
    possible = _numberings(building.name, building.floors, walk, own, parameters)
    meetings = [met(ones, each, parameters) for each, _ in possible]
    alignments = [alignment_by(each, parameters) for each in meetings]
    best = int(np.argmax([each.evidence for each in alignments]))
    (numbered, there), meeting, found = possible[best], meetings[best], alignments[best]
    if known_start:
        trajectory, found = laid_onto(meeting, numbered, parameters), replace(found, refusal="")
    else:
        trajectory, found = aligned_onto(meeting, found, numbered, parameters)
        if found.refusal:
            return building, {}, found, there
    floors = {
        level: MergedFloor(_renewed(maps.get(level), *part, parameters), {walk.name: part[1]})
        for level, part in _parts(numbered, trajectory, there).items()
    }
    grown = _grown_building(building, [*maps, *floors], numbered, trajectory, there)
    return grown, floors, found, there


def _renewed(
    floor_map: FloorMap | None,
    part: MappedWalk,
    trajectory: Trajectory,
    parameters: MergeParameters,
) -> FloorMap:
    """The map of a floor with a walk on it; that of the walk where nobody had been."""
    newer = map_of(part, trajectory, parameters)
    return newer if floor_map is None else renewed(floor_map, newer, parameters)


def _grown_building(
    building: Building,
    levels: Collection[int],
    walk: MappedWalk,
    trajectory: Trajectory,
    own: Floors,
) -> Building:
    """The building with the floors and passages that a walk adds; its heights stay."""
    assert walk.levels is not None
    heights_m = {each.level: each.height_m for each in building.floors}
    off_m = np.mean(
        [heights_m[each.level] - each.height_m for each in own if each.level in heights_m]
    )
    new = [
        BuildingFloor(each.level, round(each.height_m + float(off_m), 2))
        for each in own
        if each.level in levels and each.level not in heights_m
    ]
    walked = [
        passage
        for passage in passages_walked(trajectory, FloorsVisited(walk.levels, own))
        if {passage.from_level, passage.to_level} <= set(levels)
    ]
    floors = sorted((*building.floors, *new), key=lambda each: each.level)
    return Building(building.name, tuple(floors), gathered_passages([*building.passages, *walked]))
