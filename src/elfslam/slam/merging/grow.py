"""Walks become a map, and a map takes in more walks: read it aloud and you know how.

Walks of unknown starts are clustered by pairwise alignment: which share a place, and how they lie
there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose, inverse
from elfslam.base.parameters import digest
from elfslam.base.values import Announce, Closures, FloorMap, Trajectory, silent
from elfslam.slam.merging.forgetting import renewed
from elfslam.slam.merging.joint_graph import against_map, joined_walks
from elfslam.slam.merging.members import (
    MappedWalk,
    MergeParameters,
    Side,
    links_between,
    meeting_of,
    middles,
    placed,
    side_of,
    sides_of,
    similarity_to,
    usual_of,
)
from elfslam.stages.floormap import trajectory_map
from elfslam.stages.map_alignment import Registration, WalkPair, align


@dataclass(frozen=True, eq=False)
class Joined:
    """Walks that share a frame: their names, their trajectories in it, and the map of them all."""

    names: tuple[str, ...]
    trajectories: tuple[Trajectory, ...]
    floor_map: FloorMap


@dataclass(frozen=True, eq=False)
class Merged:
    """The maps that came of some walks, the one of most walks first, and who stayed out and why.

    `pairs` says by names how each pair came out.
    """

    maps: tuple[Joined, ...]
    refused: dict[str, str]
    pairs: dict[tuple[str, str], Registration]


def merge(
    walks: Sequence[MappedWalk],
    parameters: MergeParameters,
    *,
    known_starts: bool = False,
    announce: Announce = silent,
) -> Merged:
    """Maps of the walks that certainly share a place; the oldest walk comes first.

    With `known_starts` all share one frame already. Raises InputError where their encoders differ
    or names repeat, NoAnswerError where a graph has no solution.
    """
    check_encoders([(walk.name, walk.features.encoder) for walk in walks])
    sides = [side_of(walk, parameters) for walk in walks]
    if known_starts:
        found = _in_one_frame(sides, parameters)
    else:
        found = grouped(sides, parameters, lambda share: announce("comparing walks", share))
    announce("joining walks", None)
    kept = [
        _borne_out(group, walks, sides, found, parameters, known_starts=known_starts)
        for group in found.groups
        if len(group.frames) > 1
    ]
    maps = tuple(joined for joined, _ in kept if joined is not None)
    inside = {name for each in maps for name in each.names}
    dropped = {name: why for _, some in kept for name, why in some.items()}
    refused = {
        walk.name: dropped.get(walk.name) or _why_not(k, walks, found)
        for k, walk in enumerate(walks)
        if walk.name not in inside
    }
    pairs = {(walks[a].name, walks[b].name): each for (a, b), each in found.pairs.items()}
    return Merged(maps, refused, pairs)


@dataclass(frozen=True, eq=False)
class Meeting:
    """The walks of a map, one more, and what it has in common with them."""

    ones: Sequence[Side]
    other: Side
    pair: WalkPair


def add_walk(
    floor_map: FloorMap, walk: MappedWalk, parameters: MergeParameters
) -> tuple[FloorMap, Registration, Trajectory]:
    """The map with one more walk, if it certainly belongs there; its spots stay where they are.

    Else the map as it was: the alignment says why. Raises InputError where the encoders differ.
    """
    check_map_encoder(floor_map, walk)
    meeting = met(sides_of(floor_map, parameters), walk, parameters)
    found = alignment_by(meeting, parameters)
    trajectory, found = aligned_onto(meeting, found, walk, parameters)
    if found.refusal:
        return floor_map, found, trajectory
    return renewed(floor_map, map_of(walk, trajectory, parameters), parameters), found, trajectory


def lay_walk(
    floor_map: FloorMap, walk: MappedWalk, parameters: MergeParameters
) -> tuple[FloorMap, Trajectory]:
    """The map with one more walk of its own frame, which needs no evidence; its spots stay.

    Raises InputError where the encoders differ, NoAnswerError where the graph has no solution.
    """
    check_map_encoder(floor_map, walk)
    meeting = met(sides_of(floor_map, parameters), walk, parameters)
    trajectory = laid_onto(meeting, walk, parameters)
    return renewed(floor_map, map_of(walk, trajectory, parameters), parameters), trajectory


def met(ones: Sequence[Side], walk: MappedWalk, parameters: MergeParameters) -> Meeting:
    """A walk compared with those of a map."""
    other = side_of(walk, parameters)
    links = [links_between(one, other, parameters) for one in ones]
    return Meeting(ones, other, meeting_of(ones, other, links, parameters))


def alignment_by(meeting: Meeting, parameters: MergeParameters) -> Registration:
    """How a walk lies to those of a map, by what they have in common."""
    usual = usual_of([*meeting.ones, meeting.other])
    return align(meeting.pair, usual, parameters.alignment)


def aligned_onto(
    meeting: Meeting, found: Registration, walk: MappedWalk, parameters: MergeParameters
) -> tuple[Trajectory, Registration]:
    """A walk bent onto those of a map as it was aligned; as it was where that is refused.

    Bent onto them it must still be similar enough.
    """
    if found.refusal:
        return walk.trajectory, found
    pair = meeting.pair
    trajectory = against_map(walk, found.one_from_other, pair.one, pair.links, parameters)
    bent = replace(meeting.other, poses=middles(trajectory.world_from_body))
    alike = similarity_to(meeting.ones, bent, parameters)
    if alike < parameters.alignment.least_resemblance:
        refusal = f"bent onto it it {_too_little(alike)}"
        return walk.trajectory, replace(found, refusal=refusal)
    return _less_sure(trajectory, meeting.ones), found


def laid_onto(meeting: Meeting, walk: MappedWalk, parameters: MergeParameters) -> Trajectory:
    """A walk of the frame of a map, bent onto its walks without evidence.

    It is tied to where it began, or to where its walker tapped on a plan, and to spots that sound
    alike. Raises NoAnswerError where the graph has no solution.
    """
    frame, pair = np.zeros(3), meeting.pair
    bent = against_map(walk, frame, pair.one, pair.links, parameters, known_start=True)
    return _less_sure(bent, meeting.ones)


def _less_sure(trajectory: Trajectory, ones: Sequence[Side]) -> Trajectory:
    """The same where the spots that it was bent onto are uncertain themselves."""
    covariance = trajectory.covariance.copy()
    covariance[:, :2, :2] += np.mean([one.sigma_m for one in ones]) ** 2 * np.eye(2)
    return replace(trajectory, covariance=covariance)


def check_map_encoder(floor_map: FloorMap, walk: MappedWalk) -> None:
    """Raise InputError where a map and a walk have features of different encoders."""
    known = [("the map", item.encoder) for item in floor_map.payloads if item.kind == "elf"]
    check_encoders([*known, (walk.name, walk.features.encoder)])


def check_encoders(named: Sequence[tuple[str, str]]) -> None:
    """Raise InputError where features of different encoders would be compared."""
    for name, encoder in named[1:]:
        if encoder != named[0][1]:
            raise InputError(
                f"merge: {named[0][0]} was made with encoder {named[0][1]}, {name} with {encoder}; "
                "map them again with the same encoder",
                argument="encoder",
            )


def map_of(walk: MappedWalk, trajectory: Trajectory, parameters: MergeParameters) -> FloorMap:
    """The map of one walk in the frame of its trajectory."""
    return trajectory_map(
        trajectory,
        walk.features,
        parameters.floormap,
        parameters_digest=digest(parameters),
        source=walk.name,
    )


def _borne_out(
    group: Group,
    walks: Sequence[MappedWalk],
    sides: Sequence[Side],
    found: Grouped,
    parameters: MergeParameters,
    *,
    known_starts: bool,
) -> tuple[Joined | None, dict[str, str]]:
    """The walks of a group as one map, without those that their own graph does not bear out.

    Bent onto the others, each must still be similar enough to them to be accepted; the worst
    leaves, with the reason, until all do. With known starts nothing needs evidence.
    """
    frames, refused = dict(group.frames), dict[str, str]()
    while len(frames) > 1:
        members = sorted(frames)
        inside = [walks[k] for k in members]
        trajectories = _bent(Group(frames), walks, found, parameters, known_starts=known_starts)
        own = [sides[k] for k in members]
        alike = [] if known_starts else _alike(own, trajectories, parameters)
        if min(alike, default=np.inf) >= parameters.alignment.least_resemblance:
            names = tuple(walk.name for walk in inside)
            floor_map = map_of_walks(inside, trajectories, parameters)
            return Joined(names, tuple(trajectories), floor_map), refused
        worst = int(np.argmin(alike))
        refused[inside[worst].name] = f"bent onto the others it {_too_little(alike[worst])}"
        del frames[members[worst]]
    reason = next(iter(refused.values()))
    return None, {**refused, **{walks[k].name: reason for k in frames}}


def _alike(
    sides: Sequence[Side], trajectories: Sequence[Trajectory], parameters: MergeParameters
) -> list[float]:
    """How similar each walk is to the others where its trajectory puts it."""
    bent = [
        replace(side, poses=middles(walk.world_from_body))
        for side, walk in zip(sides, trajectories, strict=True)
    ]
    return [
        similarity_to(bent[:k] + bent[k + 1 :], each, parameters) for k, each in enumerate(bent)
    ]


def _too_little(resemblance: float) -> str:
    return f"resembles them no more than {resemblance:.0%} of the usual"


def _bent(
    group: Group,
    walks: Sequence[MappedWalk],
    found: Grouped,
    parameters: MergeParameters,
    *,
    known_starts: bool,
) -> list[Trajectory]:
    """The walks of a group in the frame of the oldest, by one graph."""
    members = sorted(group.frames)
    place = {k: at for at, k in enumerate(members)}
    links = {
        (place[a], place[b]): each
        for (a, b), each in found.links.items()
        if a in place and b in place
    }
    frames: list[F64] = [group.seen_from(members[0], k) for k in members]
    inside = [walks[k] for k in members]
    return joined_walks(inside, frames, links, parameters, known_starts=known_starts)


def map_of_walks(
    walks: Sequence[MappedWalk], trajectories: Sequence[Trajectory], parameters: MergeParameters
) -> FloorMap:
    """The map of some walks, one after the other."""
    made = [map_of(*pair, parameters) for pair in zip(walks, trajectories, strict=True)]
    floor_map = made[0]
    for newer in made[1:]:
        floor_map = renewed(floor_map, newer, parameters)
    return floor_map


def _in_one_frame(sides: Sequence[Side], parameters: MergeParameters) -> Grouped:
    """All walks as one group that lies as they say; the links between them."""
    pairs = [(a, b) for b in range(len(sides)) for a in range(b)]
    links = {(a, b): links_between(sides[a], sides[b], parameters) for a, b in pairs}
    return Grouped([Group({k: np.zeros(3) for k in range(len(sides))})], links, {})


def _why_not(k: int, walks: Sequence[MappedWalk], found: Grouped) -> str:
    """What spoke against the most promising partner of walk k."""
    mine = {pair: each for pair, each in found.pairs.items() if k in pair}
    if not mine:
        return "there is no other walk"
    pair = max(mine, key=lambda each: mine[each].evidence)
    other = walks[pair[0] if pair[1] == k else pair[1]].name
    return f"with {other}: {mine[pair].refusal or 'contradicts the others'}"


Links = dict[tuple[int, int], Closures]
"""What sounds alike, by pair of walks a < b: i of a and j of b."""


@dataclass(frozen=True, eq=False)
class Group:
    """Walks that share a frame, by number, and where each lies in it (3)."""

    frames: dict[int, F64]

    def seen_from(self, one: int, other: int) -> F64:
        """Where walk `other` lies, seen from walk `one`."""
        return compose(inverse(self.frames[one]), self.frames[other])


@dataclass(frozen=True, eq=False)
class Grouped:
    """All walks in groups, the largest first; links between them; how each pair came out."""

    groups: list[Group]
    links: Links
    pairs: dict[tuple[int, int], Registration]


def grouped(
    sides: Sequence[Side], parameters: MergeParameters, announce: Callable[[float], None]
) -> Grouped:
    """Walks of unknown starts in groups: the best pairs first, then loners against each group."""
    links: Links = {}
    pairs: dict[tuple[int, int], Registration] = {}
    every = list(combinations(range(len(sides)), 2))
    for count, (a, b) in enumerate(every):
        announce(count / len(every))
        links[a, b] = links_between(sides[a], sides[b], parameters)
        pairs[a, b] = pair_alignment(sides[a], sides[b], links[a, b], parameters)
    groups = {k: Group({k: np.zeros(3)}) for k in range(len(sides))}
    accepted = [pair for pair in every if not pairs[pair].refusal]
    for a, b in sorted(accepted, key=lambda pair: -pairs[pair].evidence):
        if groups[a] is not groups[b]:
            _unite(groups, a, b, pairs[a, b].one_from_other)
    for k in range(len(sides)):
        if len(groups[k].frames) == 1:
            _take_in(groups, k, sides, links, parameters)
    distinct = {id(group): group for group in groups.values()}.values()
    for a, b in accepted:
        off_m = _off_m(groups[a], a, b, pairs[a, b], sides[b])
        if off_m > parameters.alignment.rival_m + 2 * np.hypot(sides[a].sigma_m, sides[b].sigma_m):
            refusal = f"contradicts better pairs by {off_m:.1f} m"
            pairs[a, b] = replace(pairs[a, b], refusal=refusal)
    return Grouped(sorted(distinct, key=lambda group: -len(group.frames)), links, pairs)


def pair_alignment(
    one: Side, other: Side, links: Closures, parameters: MergeParameters
) -> Registration:
    """How two walks lie to each other."""
    meeting = meeting_of([one], other, [links], parameters)
    return align(meeting, usual_of([one, other]), parameters.alignment)


def turned_round(links: Closures) -> Closures:
    """The same links seen from the other walk."""
    return Closures(links.j, links.i, links.score, inverse(links.i_from_j), links.covariance)


def _off_m(group: Group, a: int, b: int, pair: Registration, side: Side) -> float:
    """How far a pair puts walk b from where its group has it, on average."""
    one, other = (
        compose(frame, side.poses) for frame in (pair.one_from_other, group.seen_from(a, b))
    )
    return float(np.linalg.norm((one - other)[:, :2], axis=1).mean())


def _unite(groups: dict[int, Group], a: int, b: int, a_from_b: F64) -> None:
    """The groups of walks a and b become one, in the frame of a's."""
    move = compose(compose(groups[a].frames[a], a_from_b), inverse(groups[b].frames[b]))
    moved = {k: compose(move, frame) for k, frame in groups[b].frames.items()}
    united = Group({**groups[a].frames, **moved})
    for k in united.frames:
        groups[k] = united


def _take_in(
    groups: dict[int, Group],
    loner: int,
    sides: Sequence[Side],
    links: Links,
    parameters: MergeParameters,
) -> None:
    """A walk that no single other could place joins the group that can."""
    found: list[tuple[int, F64]] = []
    larger = {id(group): group for group in groups.values() if len(group.frames) > 1}
    for group in larger.values():
        members = list(group.frames)
        ones = [placed(sides[k], group.frames[k]) for k in members]
        seen = [links[k, loner] if k < loner else turned_round(links[loner, k]) for k in members]
        meeting = meeting_of(ones, sides[loner], seen, parameters)
        got = align(meeting, usual_of([*ones, sides[loner]]), parameters.alignment)
        if not got.refusal:
            member = members[0]
            frame = compose(inverse(group.frames[member]), got.one_from_other)
            found.append((member, frame))
    if len(found) == 1:
        _unite(groups, found[0][0], loner, found[0][1])
