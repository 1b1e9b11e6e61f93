"""Which walks share a frame: those of one place, however each began, and no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.geometry import between, compose, inverse
from elfslam.base.values import Closures
from elfslam.slam.merging import MergeParameters, groups
from elfslam.slam.merging.groups import grouped, turned_round
from elfslam.slam.merging.members import Side, links_between, side_of
from elfslam.stages.map_alignment import Registration

KNOWN = MergeParameters()
STARTS = np.array([[0.0, 0.0, 0.0], [5.0, -3.0, 2.0], [-20.0, 7.0, -1.0]])


def ignore(share: float) -> None:
    """Nobody watches."""


def test_walks_of_one_place_share_a_frame_and_another_place_stays_out(
    walker: Callable, here: Callable, elsewhere: Callable
) -> None:
    walks = [walker(here, str(k), start=STARTS[k], seed=k) for k in range(3)]
    walks.append(walker(elsewhere, "away"))
    found = grouped([side_of(walk, KNOWN) for walk in walks], KNOWN, ignore)
    assert [sorted(group.frames) for group in found.groups] == [[0, 1, 2], [3]]
    for one, other in ((0, 1), (1, 2), (0, 2)):
        wanted = compose(STARTS[one], inverse(STARTS[other]))
        npt.assert_allclose(found.groups[0].seen_from(one, other), wanted, atol=0.15)
    assert found.pairs[0, 3].refusal


def test_links_turned_round_say_the_same_from_the_other_side(
    walker: Callable, here: Callable
) -> None:
    one, other = (side_of(walker(here, str(k), seed=k), KNOWN) for k in range(2))
    links = links_between(one, other, KNOWN)
    back = turned_round(links)
    assert len(links.i) > 20
    ends = between(compose(one.poses[links.i], links.i_from_j), other.poses[links.j])
    again = between(other.poses[back.i], compose(one.poses[back.j], inverse(back.i_from_j)))
    npt.assert_allclose(np.linalg.norm(ends[:, :2], axis=1), np.linalg.norm(again[:, :2], axis=1))


def test_a_loner_joins_the_group_that_knows_both_ends_of_its_way(
    walker: Callable, here: Callable
) -> None:
    """Parts of a round of 90 m: neither of the others alone has enough in common with the last."""
    parts = [(0.0, 0.45), (0.22, 0.67), (0.62, 1.05)]
    walks = [
        walker(here, str(k), way={"width_m": 27, "depth_m": 18, "first": a, "turns": b}, seed=k)
        for k, (a, b) in enumerate(parts)
    ]
    found = grouped([side_of(walk, KNOWN) for walk in walks], KNOWN, ignore)
    assert found.pairs[0, 2].refusal
    assert found.pairs[1, 2].refusal
    assert [sorted(group.frames) for group in found.groups] == [[0, 1, 2]]
    npt.assert_allclose(found.groups[0].seen_from(0, 2), 0, atol=0.3)


def test_a_pair_that_contradicts_better_ones_is_told(
    walker: Callable, here: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The weakest of three pairs is put 5 m beside where the others have it."""
    sides = [side_of(walker(here, str(k), seed=k), KNOWN) for k in range(3)]
    honest = groups.pair_alignment

    def spoilt(
        one: Side, other: Side, links: Closures, parameters: MergeParameters
    ) -> Registration:
        found = honest(one, other, links, parameters)
        if (one, other) != (sides[0], sides[2]):
            return found
        return replace(found, one_from_other=np.add(found.one_from_other, [5, 0, 0]), evidence=1.0)

    monkeypatch.setattr(groups, "pair_alignment", spoilt)
    found = grouped(sides, KNOWN, ignore)
    assert found.pairs[0, 2].refusal == "contradicts better pairs by 5.0 m"
    npt.assert_allclose(found.groups[0].seen_from(0, 2), 0, atol=0.15)
