"""Walks become a map, which takes in more; what newer walks pass fades."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose, inverse
from elfslam.base.values import Closures, Features, FloorMap, MeanSimilarity, Run
from elfslam.slam.merging import MergeParameters, add_walk, grow, lay_walk, members, merge, walk_of
from elfslam.slam.merging.forgetting import chosen_spots, renewed, stacked
from elfslam.slam.merging.grow import grouped, map_of, turned_round
from elfslam.slam.merging.members import Side, links_between, side_of, similarity_to
from elfslam.stages.map_alignment import Registration

KNOWN = MergeParameters()
START = np.array([5.0, -3.0, 2.0])


def test_two_walks_become_a_map_in_the_frame_of_the_first(walker: Callable, here: Callable) -> None:
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


def test_a_walk_joins_a_fixed_map(walker: Callable, here: Callable, elsewhere: Callable) -> None:
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
    xy_m = away.trajectory.world_from_body[:, :2]
    npt.assert_allclose(trajectory.world_from_body[:, :2], xy_m, atol=0.05)
    assert trajectory.covariance[0, 0, 0] > 0.5 * KNOWN.merging.start_sigma_m**2


def test_a_laid_walk_is_drawn_to_what_sounds_alike(walker: Callable, here: Callable) -> None:
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


def test_similarity_of_common_ground(walker: Callable, here: Callable, elsewhere: Callable) -> None:
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


def test_links_turned_round_say_it_from_the_other_side(walker: Callable, here: Callable) -> None:
    one, other = (side_of(walker(here, str(k), seed=k), KNOWN) for k in range(2))
    links = links_between(one, other, KNOWN)
    back = turned_round(links)
    assert len(links.i) > 20
    ends = between(compose(one.poses[links.i], links.i_from_j), other.poses[links.j])
    again = between(other.poses[back.i], compose(one.poses[back.j], inverse(back.i_from_j)))
    npt.assert_allclose(np.linalg.norm(ends[:, :2], axis=1), np.linalg.norm(again[:, :2], axis=1))


def test_a_loner_joins_the_group_that_knows_both_ends(walker: Callable, here: Callable) -> None:
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


def test_a_map_is_walked_again_in_even_steps(walker: Callable, here: Callable) -> None:
    walks = [walker(here, str(k), seed=k) for k in range(2)]
    floor_map = stacked(*(map_of(walk, walk.trajectory, KNOWN) for walk in walks))
    one, other = members.sides_of(floor_map, KNOWN)
    steps_m = np.linalg.norm(np.diff(one.poses[:, :2], axis=0), axis=1)
    npt.assert_allclose(np.median(steps_m), KNOWN.merging.spacing_m, atol=0.1)
    assert len(one.poses) == pytest.approx(len(walks[0].odometry.t_s), rel=0.15)
    assert not np.array_equal(one.poses, other.poses)
    assert len(members.links_between(one, members.side_of(walks[1], KNOWN), KNOWN).i) > 20


def test_a_walk_resembles_itself_as_it_does_in_its_map(walker: Callable, here: Callable) -> None:
    walk = walker(here, "a")
    (again,) = members.sides_of(map_of(walk, walk.trajectory, KNOWN), KNOWN)
    side = members.side_of(walk, KNOWN)
    assert side.usual == pytest.approx(again.usual, rel=0.15)
    assert side.sigma_m == pytest.approx(0.1)
    louder = replace(side, usual=4 * side.usual)
    assert members.usual_of([side, louder]) == pytest.approx(2 * side.usual)


def test_a_meeting_counts_footsteps_of_all_walks(walker: Callable, here: Callable) -> None:
    sides = [members.side_of(walker(here, str(k), seed=k), KNOWN) for k in range(3)]
    links = [members.links_between(one, sides[2], KNOWN) for one in sides[:2]]
    meeting = members.meeting_of(sides[:2], sides[2], links, KNOWN)
    count = len(sides[0].poses)
    npt.assert_array_equal(meeting.links.i[len(links[0].i) :], links[1].i + count)
    assert meeting.scores.shape == (2 * count, count)
    same = members.placed(sides[0], np.zeros(3))
    npt.assert_array_equal(same.poses[:, :2], sides[0].poses[:, :2])


def test_only_walks_with_sound_are_merged(walker: Callable, here: Callable) -> None:
    walk = walker(here, "silent")
    silent = MeanSimilarity(np.zeros((1, 1)), "motion")
    known = (walk.odometry, silent, walk.closures, walk.trajectory)
    with pytest.raises(InputError, match="silent: was mapped without sound"):
        walk_of(Run("silent", *known, None, None, None))
    assert walk_of(Run("loud", *known, None, None, walk.features)).name == "loud"


FADE = KNOWN.merging.fade


@pytest.fixture
def made(walker: Callable) -> Callable[..., FloorMap]:
    """The map of one walk over a place, in the frame of the place."""

    def walked(heard: Callable, seed: int) -> FloorMap:
        walk = walker(heard, str(seed), seed=seed)
        return map_of(walk, walk.trajectory, KNOWN)

    return walked


def test_what_is_passed_again_fades_and_what_is_not_stays(made: Callable, here: Callable) -> None:
    old, new = made(here, 1), made(here, 2)
    left = new.xy_m[:, 0] < 4
    grown = renewed(old, chosen_spots(new, left), KNOWN)
    npt.assert_array_equal(grown.weight[: len(old.xy_m)][old.xy_m[:, 0] < 3], FADE)
    npt.assert_array_equal(grown.weight[: len(old.xy_m)][old.xy_m[:, 0] > 5], 1.0)
    npt.assert_array_equal(grown.weight[len(old.xy_m) :], 1.0)
    assert not grown.changed.any()


def test_what_faded_away_leaves_the_map(made: Callable, here: Callable) -> None:
    known = replace(KNOWN, merging=members.MergingParameters(fade=0.05))
    old, new = made(here, 1), made(here, 2)
    grown = renewed(old, new, known)
    assert (grown.walk == 0).mean() < 0.05
    assert grown.sources == ("1", "2")


def changing(here: Callable, elsewhere: Callable) -> Callable:
    """The place, another one where y is above 4 m."""

    def heard(poses: np.ndarray) -> np.ndarray:
        return np.where(poses[:, 1:2] > 4, elsewhere(poses), here(poses))

    return heard


def test_a_changed_corner_is_marked_and_fades_faster(
    made: Callable, here: Callable, elsewhere: Callable
) -> None:
    old, new = made(here, 1), made(changing(here, elsewhere), 2)
    grown = renewed(old, new, KNOWN)
    before = slice(0, len(old.xy_m))
    changed, y_m = grown.changed[before], old.xy_m[:, 1]
    assert changed[y_m > 5].mean() > 0.9
    assert not changed[y_m < 3].any()
    npt.assert_array_equal(grown.weight[before][changed], KNOWN.merging.fade_changed)
    assert not grown.changed[len(old.xy_m) :].any()


def test_one_pass_changes_nothing(made: Callable, here: Callable, elsewhere: Callable) -> None:
    old, new = made(here, 1), made(changing(here, elsewhere), 2)
    once = chosen_spots(new, new.order < 200)
    assert not renewed(old, once, KNOWN).changed.any()


def test_maps_are_stacked_walk_by_walk(made: Callable, here: Callable) -> None:
    one, other = made(here, 1), made(here, 2)
    both = stacked(stacked(one, other), one)
    npt.assert_array_equal(np.unique(both.walk), [0, 1, 2])
    npt.assert_array_equal(both.xy_m[both.walk == 1], other.xy_m)
    npt.assert_array_equal(both.payloads[0].vectors[both.walk == 2], one.payloads[0].vectors)
    assert both.sources == ("1", "2", "1")
