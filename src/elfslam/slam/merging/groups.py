"""Clusters of walks by pairwise alignment: which share a place, and how they lie there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.geometry import compose, inverse
from elfslam.base.values import Closures
from elfslam.slam.merging.members import Side, links_between, meeting_of, placed, usual_of
from elfslam.slam.merging.parameters import MergeParameters
from elfslam.stages.map_alignment import Registration, align

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
