"""Walks become a map, and a map takes in more."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose, inverse
from elfslam.base.values import Closures, Features
from elfslam.slam.merging import MergeParameters, add_walk, grow, lay_walk, merge
from elfslam.slam.merging.grow import grouped, turned_round
from elfslam.slam.merging.members import Side, links_between, side_of, similarity_to
from elfslam.stages.map_alignment import Registration

KNOWN = MergeParameters()
START = np.array([5.0, -3.0, 2.0])


def test_two_walks_become_one_map_in_the_frame_of_the_first(
    walker: Callable, here: Callable
) -> None:
    walks = [walker(here, "a"), walker(here, "b", start=START, seed=1)]
    made = merge(walks, KNOWN)
    (joined,) = made.maps
    assert joined.names == joined.floor_map.sources == ("a", "b")
    assert made.refused == {}
    back = compose(inverse(START), walks[1].trajectory.world_from_body)
    npt.assert_allclose(joined.trajectories[1].world_from_body[:, :2], back[:, :2], atol=0.35)
    npt.assert_array_equal(np.unique(joined.floor_map.walk), [0, 1])
    assert made.pairs["a", "b"].refusal == ""


def test_two_rooms_stay_two_maps(walker: Callable, here: Callable, elsewhere: Callable) -> None:
    walks = [
        walker(heard, name, seed=k)
        for k, (heard, name) in enumerate(zip([here, elsewhere] * 2, "abcd", strict=True))
    ]
    made = merge(walks, KNOWN)
    assert sorted(each.names for each in made.maps) == [("a", "c"), ("b", "d")]
    alone = merge(walks[:2], KNOWN)
    assert alone.maps == ()
    assert set(alone.refused) == {"a", "b"}
    assert alone.refused["a"].startswith("with b: ")


def test_a_walk_joins_a_map_whose_spots_stay(
    walker: Callable, here: Callable, elsewhere: Callable
) -> None:
    floor_map = merge([walker(here, "a"), walker(here, "b", seed=1)], KNOWN).maps[0].floor_map
    grown, found, trajectory = add_walk(floor_map, walker(here, "c", start=START, seed=2), KNOWN)
    assert found.refusal == ""
    assert grown.sources == ("a", "b", "c")
    npt.assert_array_equal(grown.xy_m[grown.walk < 2], floor_map.xy_m)
    true = walker(here, "c", seed=2).trajectory.world_from_body
    assert np.median(np.linalg.norm((trajectory.world_from_body - true)[:, :2], axis=1)) < 0.2
    assert (grown.weight[grown.walk == 2] == 1).all()
    assert grown.weight[grown.walk == 0].mean() < 0.9
    same, refused, _ = add_walk(floor_map, walker(elsewhere, "d"), KNOWN)
    assert same is floor_map
    assert refused.refusal


def test_known_starts_need_no_evidence(walker: Callable, here: Callable) -> None:
    walks = [walker(here, str(k), start=[20.0 * k, 0.0, 0.0]) for k in range(2)]
    assert merge(walks, KNOWN).maps[0].floor_map.xy_m[:, 0].max() < 12
    (joined,) = merge(walks, KNOWN, known_starts=True).maps
    assert joined.floor_map.xy_m[:, 0].max() > 25
    unlike = walker(lambda poses: -here(poses), "unlike")
    assert merge([walks[0], unlike], KNOWN).maps == ()
    (against,) = merge([walks[0], unlike], KNOWN, known_starts=True).maps
    assert against.names == ("0", "unlike")


def test_a_walk_is_laid_where_it_says_in_a_map_that_it_shares_no_ground_with(
    walker: Callable, here: Callable
) -> None:
    floor_map = merge([walker(here, "a"), walker(here, "b", seed=1)], KNOWN).maps[0].floor_map
    away = walker(here, "c", start=[20.0, 0.0, 0.0])
    laid, trajectory = lay_walk(floor_map, away, KNOWN)
    assert laid.sources == ("a", "b", "c")
    npt.assert_array_equal(laid.xy_m[laid.walk < 2], floor_map.xy_m)
    npt.assert_allclose(
        trajectory.world_from_body[:, :2], away.trajectory.world_from_body[:, :2], atol=0.05
    )
    assert trajectory.covariance[0, 0, 0] > 0.5 * KNOWN.merging.start_sigma_m**2


def test_a_walk_that_is_laid_is_drawn_to_what_sounds_alike(
    walker: Callable, here: Callable
) -> None:
    floor_map = merge([walker(here, "a"), walker(here, "b", seed=1)], KNOWN).maps[0].floor_map
    true = walker(here, "c", seed=2).trajectory.world_from_body
    beside = walker(here, "c", start=[0.6, 0.0, 0.0], seed=2)
    _, trajectory = lay_walk(floor_map, beside, KNOWN)
    before, after = (
        np.median(np.linalg.norm((poses - true)[:, :2], axis=1))
        for poses in (beside.trajectory.world_from_body, trajectory.world_from_body)
    )
    assert after < 0.5 * before


def test_other_encoders_are_refused_by_name(walker: Callable, here: Callable) -> None:
    one, other = walker(here, "a"), walker(here, "b")
    features = Features(other.features.t_s, other.features.vectors, "another")
    changed = replace(other, features=features)
    with pytest.raises(InputError, match="a was made with encoder planted, b with another"):
        merge([one, changed], KNOWN)
    floor_map = merge([one, other], KNOWN).maps[0].floor_map
    with pytest.raises(InputError, match="the map was made with encoder planted, b with another"):
        add_walk(floor_map, changed, KNOWN)
    with pytest.raises(InputError, match="encoder"):
        lay_walk(floor_map, changed, KNOWN)


def test_a_walk_that_the_graph_does_not_bear_out_leaves(
    walker: Callable, here: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The third of three walks resembles the others too little once it is bent onto them."""
    walks = [walker(here, str(k), seed=k) for k in range(3)]
    third = side_of(walks[2], KNOWN)

    def judged(ones: Sequence[Side], other: Side, parameters: MergeParameters) -> float:
        return 0.5 if np.array_equal(other.means, third.means) else 0.9

    floor_map = merge(walks[:2], KNOWN).maps[0].floor_map
    monkeypatch.setattr(grow, "similarity_to", judged)
    made = merge(walks, KNOWN)
    assert [each.names for each in made.maps] == [("0", "1")]
    reason = "bent onto the others it resembles them no more than 50% of the usual"
    assert made.refused == {"2": reason}
    pair = merge(walks[1:], KNOWN)
    assert pair.maps == ()
    assert set(pair.refused) == {"1", "2"}
    same, found, _ = add_walk(floor_map, walks[2], KNOWN)
    assert same is floor_map
    assert "no more than 50% of the usual" in found.refusal


def test_similarity_is_that_of_the_common_ground(
    walker: Callable, here: Callable, elsewhere: Callable
) -> None:
    one, other, away = (
        side_of(walker(heard, "w", seed=k), KNOWN)
        for k, heard in enumerate((here, here, elsewhere))
    )
    assert similarity_to([one], other, KNOWN) > 0.9
    assert similarity_to([one], away, KNOWN) < 0.6
    far = replace(other, poses=np.add(other.poses, [100, 0, 0]))
    assert similarity_to([one], far, KNOWN) == 0.0


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
    honest = grow.pair_alignment

    def spoilt(
        one: Side, other: Side, links: Closures, parameters: MergeParameters
    ) -> Registration:
        found = honest(one, other, links, parameters)
        if (one, other) != (sides[0], sides[2]):
            return found
        return replace(found, one_from_other=np.add(found.one_from_other, [5, 0, 0]), evidence=1.0)

    monkeypatch.setattr(grow, "pair_alignment", spoilt)
    found = grouped(sides, KNOWN, ignore)
    assert found.pairs[0, 2].refusal == "contradicts better pairs by 5.0 m"
    npt.assert_allclose(found.groups[0].seen_from(0, 2), 0, atol=0.15)
