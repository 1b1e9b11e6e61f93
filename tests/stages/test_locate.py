"""Fixes: right where the map knows the place, and honest where it does not."""

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.values import Features, Fixes, FixStatus, FloorMap, Payload
from elfslam.stages import locate

PARAMETERS = locate.LocateParameters()
SPOTS = 50
SPACING_M = 0.5
ECHOES_PER_FIX = 6


def unit(rows: F64) -> F32:
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True), dtype=np.float32)


def place_vectors(seed: int = 0) -> F32:
    """What each spot sounds like: neighbours somewhat alike, others not at all."""
    rough = np.random.default_rng(seed).normal(size=(SPOTS + 2, 64))
    return unit(rough[1:-1] + 0.4 * (rough[:-2] + rough[2:]))


def made_map(vectors: F32, encoder: str = "stub") -> FloorMap:
    """Spots every half metre along a straight line that is walked at 30 degrees."""
    along_m = SPACING_M * np.arange(SPOTS)
    return FloorMap(
        np.column_stack([along_m * np.cos(np.pi / 6), along_m * np.sin(np.pi / 6)]),
        np.full(SPOTS, np.pi / 6),
        np.zeros(SPOTS),
        np.arange(SPOTS),
        np.tile(np.diag([0.04, 0.09]), (SPOTS, 1, 1)),
        (Payload("wifi", "rssi", np.zeros((SPOTS, 3))), Payload("elf", encoder, vectors)),
        "digest",
        ("walk",),
    )


def heard_at(vectors: F32, spots: list[int], noise: float = 0.05) -> Features:
    """Six echoes at each of the spots in turn, ten a second."""
    generator = np.random.default_rng(1)
    rows = np.repeat(vectors[spots], ECHOES_PER_FIX, axis=0)
    rows = unit(rows + noise * generator.normal(size=rows.shape))
    return Features(0.1 * np.arange(len(rows)) + 2.0, rows, "stub")


def located(features: Features, floor_map: FloorMap, **changes: float) -> Fixes:
    known = dataclasses.replace(PARAMETERS, **changes)
    return locate.locate_one_shot(features, floor_map, known)


def test_planted_places_are_found() -> None:
    vectors, spots = place_vectors(), [3, 17, 30, 44]
    floor_map = made_map(vectors)
    fixes = located(heard_at(vectors, spots), floor_map)
    npt.assert_array_equal(fixes.status, FixStatus.OK)
    npt.assert_allclose(fixes.xy_m, floor_map.xy_m[spots], atol=0.1)
    npt.assert_allclose(fixes.heading_rad, np.pi / 6, atol=1e-6)
    npt.assert_allclose(fixes.t_s, [2.3, 2.9, 3.5, 4.1])
    assert (fixes.score > 0.8).all()


def test_the_score_is_the_cosine_of_the_mean_echo_with_the_best_spot() -> None:
    vectors = place_vectors()
    given = heard_at(vectors, [12], noise=0.2)
    fixes = located(given, made_map(vectors))
    mean = given.vectors.mean(axis=0)
    npt.assert_allclose(fixes.score, [mean @ vectors[12] / np.linalg.norm(mean)], atol=1e-6)


def test_a_spot_whose_echoes_disagree_is_found_all_the_same() -> None:
    vectors = place_vectors()
    steady = made_map(vectors)
    shaken = vectors.copy()
    shaken[20] *= 0.5
    heard = heard_at(unit(vectors[[20]] + 0.6 * vectors[[35]]), [0])
    fixes = located(heard, made_map(shaken))
    npt.assert_allclose(fixes.xy_m[0], steady.xy_m[20], atol=0.1)


def test_scores_of_any_kind_make_fixes() -> None:
    floor_map = made_map(place_vectors())
    scores = np.full((3, SPOTS), 0.1, dtype=np.float32)
    scores[0, 7], scores[2] = 0.9, np.nan
    fixes = locate.fixes_of(np.array([1.0, 2.0, 3.0]), scores, floor_map, PARAMETERS)
    assert fixes.status.tolist() == [FixStatus.OK, FixStatus.UNKNOWN_PLACE, FixStatus.NO_ECHO]
    npt.assert_allclose(fixes.xy_m[0], floor_map.xy_m[7], atol=1e-6)
    assert np.isnan(fixes.score[2])


def test_between_two_spots_the_fix_lies_between_them() -> None:
    vectors = place_vectors()
    halfway = unit(vectors[[20]] + vectors[[21]])
    floor_map = made_map(vectors)
    fixes = located(heard_at(halfway, [0], noise=0.0), floor_map)
    npt.assert_allclose(fixes.xy_m[0], floor_map.xy_m[20:22].mean(axis=0), atol=0.05)


def test_the_covariance_holds_the_spread_the_spots_own_and_a_floor() -> None:
    vectors = place_vectors()
    floor_map = made_map(vectors)
    even = located(heard_at(vectors, [20], noise=0.0), floor_map)
    own = np.diag([0.04, 0.09]) + PARAMETERS.sigma_floor_m**2 * np.eye(2)
    npt.assert_allclose(even.covariance_m2[0], own, atol=0.02)
    heard, warm = heard_at(vectors, [20], noise=0.0), {"temperature": 0.5, "near_m": 3.0}
    vague = located(heard, floor_map, **warm, ambiguous_below=0.0)
    extra = vague.covariance_m2[0] - own
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    across = np.array([-along[1], along[0]])
    assert (np.linalg.eigvalsh(vague.covariance_m2[0]) > 0).all()
    assert along @ extra @ along > 0.5
    npt.assert_allclose(across @ extra @ across, 0, atol=1e-9)


@pytest.mark.parametrize("by_m", [[1e3, 1e3], [5e5, 5e6]], ids=["1 km", "UTM"])
def test_moving_the_map_moves_the_fixes_and_leaves_every_covariance(by_m: list[float]) -> None:
    vectors = place_vectors()
    floor_map, heard = made_map(vectors), heard_at(vectors, [3, 17, 30, 44])
    far = dataclasses.replace(floor_map, xy_m=floor_map.xy_m + by_m)
    # No two spots lie just so far apart.
    here, there = (located(heard, each, near_m=1.1) for each in (floor_map, far))
    npt.assert_allclose(there.xy_m - by_m, here.xy_m, atol=1e-6)
    npt.assert_allclose(there.covariance_m2, here.covariance_m2, atol=1e-6)


def test_two_far_places_that_sound_the_same_are_ambiguous() -> None:
    vectors = place_vectors().copy()
    vectors[40] = vectors[10]
    floor_map = made_map(vectors)
    doubtful = located(heard_at(vectors, [10, 25]), floor_map, ambiguous_below=0.6)
    assert doubtful.status.tolist() == [FixStatus.AMBIGUOUS, FixStatus.OK]
    middle_m = floor_map.xy_m[[10, 40]].mean(axis=0)
    npt.assert_allclose(doubtful.xy_m[0], middle_m, atol=0.5)
    apart_m = np.linalg.norm(floor_map.xy_m[40] - floor_map.xy_m[10])
    spread_m = np.sqrt(np.linalg.eigvalsh(doubtful.covariance_m2[0])[-1])
    npt.assert_allclose(spread_m, apart_m / 2, rtol=0.1)


def test_three_far_places_are_ambiguous_and_near_ones_are_not() -> None:
    far, near = place_vectors().copy(), place_vectors().copy()
    far[[25, 40]] = far[10]
    near[[9, 11]] = near[10]
    for vectors, status in ((far, FixStatus.AMBIGUOUS), (near, FixStatus.OK)):
        fixes = located(heard_at(vectors, [10]), made_map(vectors), ambiguous_below=0.5)
        assert fixes.status.tolist() == [status]


def test_an_unknown_place_gets_no_position() -> None:
    vectors = place_vectors()
    strange = heard_at(place_vectors(seed=9), [5])
    fixes = located(strange, made_map(vectors))
    assert fixes.status.tolist() == [FixStatus.UNKNOWN_PLACE]
    assert np.isnan(fixes.xy_m).all()
    assert np.isnan(fixes.covariance_m2).all()
    assert np.isnan(fixes.heading_rad).all()
    assert fixes.score[0] < PARAMETERS.unknown_below


def test_what_is_suspect_has_no_position_and_the_other_fixes_stand() -> None:
    vectors = place_vectors()
    features, floor_map = heard_at(vectors, [3, 17, 30, 44]), made_map(vectors)
    plain = located(features, floor_map)
    asked: list[F64] = []

    def second(edges_s: F64) -> Bool:
        asked.append(edges_s)
        return np.arange(len(edges_s) - 1) == 1

    fixes = locate.trusted_one_shot(features, floor_map, PARAMETERS, second)
    npt.assert_allclose(asked[0], 2.0 + 0.6 * np.arange(5))
    assert fixes.status.tolist() == [FixStatus.OK, FixStatus.SUSPECT, FixStatus.OK, FixStatus.OK]
    assert np.isnan(fixes.xy_m[1]).all()
    assert np.isnan(fixes.covariance_m2[1]).all()
    npt.assert_array_equal(fixes.xy_m[[0, 2, 3]], plain.xy_m[[0, 2, 3]])


def test_missing_echoes_are_said_and_the_other_fixes_stand() -> None:
    vectors, spots = place_vectors(), [3, 17, 30]
    whole = heard_at(vectors, spots)
    kept = np.r_[0:6, 8:10, 12:18]
    fixes = located(Features(whole.t_s[kept], whole.vectors[kept], "stub"), made_map(vectors))
    assert fixes.status.tolist() == [FixStatus.OK, FixStatus.NO_ECHO, FixStatus.OK]
    assert np.isnan(fixes.xy_m[1]).all()
    assert np.isnan(fixes.score[1])
    npt.assert_allclose(fixes.xy_m[[0, 2]], made_map(vectors).xy_m[[3, 30]], atol=0.1)


def test_a_gap_of_several_windows_gives_a_fix_for_each() -> None:
    vectors = place_vectors()
    whole, kept = heard_at(vectors, [3, 17, 30, 44]), np.r_[0:6, 18:24]
    fixes = located(Features(whole.t_s[kept], whole.vectors[kept], "stub"), made_map(vectors))
    assert fixes.status.tolist() == [0, FixStatus.NO_ECHO, FixStatus.NO_ECHO, 0]


def test_a_single_echo_is_too_little_but_no_accident() -> None:
    vectors = place_vectors()
    one = Features([2.0], vectors[:1], "stub")
    fixes = located(one, made_map(vectors))
    assert fixes.status.tolist() == [FixStatus.NO_ECHO]
    content = located(one, made_map(vectors), fewest_echoes=1)
    assert content.status.tolist() == [FixStatus.OK]


def test_every_echo_belongs_to_one_window() -> None:
    vectors = place_vectors()
    whole = heard_at(vectors, [3, 17])
    longer = Features(0.6 * np.arange(5), np.tile(vectors[8], (5, 1)), "stub")
    assert len(located(longer, made_map(vectors), fewest_echoes=1).t_s) == 5
    assert len(located(whole, made_map(vectors)).t_s) == 2
    assert len(located(whole, made_map(vectors), window_s=1.2).t_s) == 1


def test_maps_of_other_features_or_none_are_refused() -> None:
    vectors = place_vectors()
    with pytest.raises(InputError, match="with encoder other, got echoes encoded by stub; use"):
        located(heard_at(vectors, [1]), made_map(vectors, encoder="other"))
    deaf = dataclasses.replace(made_map(vectors), payloads=())
    with pytest.raises(InputError, match="map: it holds no echoes; map the place by elf"):
        located(heard_at(vectors, [1]), deaf)
    with pytest.raises(InputError, match=r"its ELFs have shape .50, 64., wanted some of 128"):
        locate.elf_payload(made_map(vectors), "stub", 128)
