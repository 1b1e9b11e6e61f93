"""Errors of walks and fixes: planted answers, laws, evo as the oracle; normalised errors."""

import json
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base.errors import InputError
from elfslam.base.geometry import chain, compose
from elfslam.base.values import Closures, Fixes, FixStatus, Odometry, Run, Trajectory, Truth
from elfslam.scoring import errors as scoring
from elfslam.scoring.consistency import Displacements, displacement_errors
from elfslam.scoring.errors import Alignment, interval, position_errors, score_closures, summarise

Moved = Callable[[Truth, np.ndarray], np.ndarray]
WHERE = np.array([3.0, -2.0, 2.1])
angle = st.floats(-3.0, 3.0)
shift = st.floats(-50.0, 50.0)


def test_scale_is_forgiven_only_where_it_should_be(truth: Truth, moved: Moved) -> None:
    poses = moved(truth, WHERE) * [1.1, 1.1, 1]
    assert position_errors(truth.t_s, poses, truth, Alignment.ALIGNED).max() > 0.3
    matched = scoring.match(truth.t_s, poses, truth)
    found = scoring.placement(matched, Alignment.ALIGNED_WITH_SCALE)
    assert found.scale == pytest.approx(1 / 1.1)
    assert position_errors(truth.t_s, poses, truth, Alignment.ALIGNED_WITH_SCALE).max() < 1e-9


def test_anchored_error_of_a_wrong_first_heading() -> None:
    """A straight walk with its heading wrong by a: the error grows as 2 d sin(a / 2)."""
    t_s, away_m, wrong = np.arange(11.0), np.linspace(0, 20, 11), 0.1
    straight = np.column_stack([away_m, 0 * away_m, 0 * away_m])
    poses = straight + [0, 0, wrong] * (t_s == 0)[:, None]
    errors = position_errors(t_s, poses, Truth(t_s, straight), Alignment.ANCHORED)
    assert np.allclose(errors, 2 * away_m * np.sin(wrong / 2))
    share = scoring.end_error_share(t_s, poses, Truth(t_s, straight))
    assert share == pytest.approx(2 * np.sin(wrong / 2))


def test_dense_truth_is_interpolated_and_only_its_span_counts() -> None:
    truth = Truth([0, 10], [[0, 0, 0], [10, 0, 0]])
    t_s = np.array([-1, 0, 2.5, 5, 11])
    poses = np.array([[9, 9, 0], [0, 0, 0], [2.5, 0.3, 0], [5, 0.4, 0], [9, 9, 0]])
    errors = position_errors(t_s, poses, truth, Alignment.ANCHORED)
    assert np.allclose(errors, [0, 0.3, 0.4])


@pytest.mark.parametrize("alignment", list(Alignment))
def test_waypoints_are_where_it_is_judged(
    truth: Truth, waypoints: Truth, moved: Moved, alignment: Alignment
) -> None:
    """Between waypoints the estimate may do as it likes; the anchor turns by travel."""
    poses = moved(truth, WHERE)
    poses[3::7] += 5.0
    poses[:, 2] = 0.0
    errors = position_errors(truth.t_s, poses, waypoints, alignment)
    assert errors.size == waypoints.t_s.size
    assert errors.max() < 1e-9


def test_the_walker_stands_at_the_first_and_last_waypoint() -> None:
    truth = Truth([0.0, 5.0, 10.0], [[0, 0, np.nan], [5, 0, np.nan], [10, 0, np.nan]])
    t_s = np.array([1.0, 5.0, 9.0])
    poses = np.array([[0, 0, 0], [5, 1, 0], [10, 0, 0]], float)
    errors = position_errors(t_s, poses, truth, Alignment.ALIGNED)
    assert np.allclose(errors, [1 / 3, 2 / 3, 1 / 3])


def test_walks_apart_in_time_are_refused(truth: Truth) -> None:
    with pytest.raises(InputError, match="share 0 times"):
        position_errors(truth.t_s + 1e4, truth.world_from_body, truth, Alignment.ALIGNED)


@settings(max_examples=25, deadline=None)
@given(x=shift, y=shift, turn=angle, seed=st.integers(0, 99))
def test_moving_changes_no_error(truth: Truth, x: float, y: float, turn: float, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, 0.3, truth.world_from_body.shape)
    poses = truth.world_from_body + noise
    there = compose(np.array([x, y, turn]), poses)
    rmse = {}
    for alignment in Alignment:
        errors = position_errors(truth.t_s, poses, truth, alignment)
        assert np.allclose(errors, position_errors(truth.t_s, there, truth, alignment), atol=1e-6)
        rmse[alignment] = summarise(errors).rmse_m
    assert rmse[Alignment.ALIGNED_WITH_SCALE] <= rmse[Alignment.ALIGNED] + 1e-9
    assert rmse[Alignment.ALIGNED] <= rmse[Alignment.ANCHORED] + 1e-9


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("alignment", [Alignment.ALIGNED, Alignment.ALIGNED_WITH_SCALE])
def test_evo_agrees(run: Run, truth: Truth, alignment: Alignment) -> None:
    pytest.importorskip("evo", reason="evo is absent (test extra)")
    from evo.core import metrics, trajectory

    def path(poses: np.ndarray) -> trajectory.PoseTrajectory3D:
        zeros = np.zeros(len(poses))
        half = poses[:, 2] / 2
        turns = np.column_stack([np.cos(half), zeros, zeros, np.sin(half)])
        xyz_m = np.column_stack([poses[:, :2], zeros])
        return trajectory.PoseTrajectory3D(xyz_m, turns, truth.t_s.copy())

    reference, estimate = path(truth.world_from_body), path(run.odometry.world_from_body)
    estimate.align(reference, correct_scale=alignment is Alignment.ALIGNED_WITH_SCALE)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((reference, estimate))
    odometry = run.odometry
    ours = position_errors(odometry.t_s, odometry.world_from_body, truth, alignment)
    theirs = error.get_statistic(metrics.StatisticsType.rmse)
    assert summarise(ours).rmse_m == pytest.approx(theirs, rel=1e-9)
    assert ours.max() == pytest.approx(error.get_statistic(metrics.StatisticsType.max), rel=1e-9)


def test_summary_of_known_errors() -> None:
    summary = summarise(np.array([0.0, 1.0, 2.0, 3.0, 4.0]))
    assert (summary.median_m, summary.mean_m, summary.q3_m) == (2, 2, 3)
    assert (summary.rmse_m, summary.maximum_m, summary.count) == (np.sqrt(6), 4, 5)
    nothing = summarise(np.empty(0))
    assert nothing.count == 0
    assert np.isnan(nothing.median_m)


def test_alignment_of_finds_where_the_map_lies(truth: Truth, moved: Moved) -> None:
    poses, size = moved(truth, WHERE), truth.t_s.size
    walk = Trajectory(truth.t_s, poses, np.zeros((size, 3, 3)), np.empty(0), "OK")
    assert np.allclose(scoring.alignment_of(walk, truth), WHERE)


def planted_fixes(xy_m: np.ndarray, t_s: np.ndarray) -> Fixes:
    """Fixes 0 and 4 are ambiguous, 1 and 5 are refused, the others stand."""
    status = np.full(t_s.size, FixStatus.OK)
    status[[0, 4]], status[1], status[5] = FixStatus.AMBIGUOUS, FixStatus.UNKNOWN_PLACE, 3
    xy_m = np.where((status >= FixStatus.UNKNOWN_PLACE)[:, None], np.nan, xy_m)
    unknown = np.full(t_s.size, np.nan)
    return Fixes(t_s, xy_m, unknown, np.full((t_s.size, 2, 2), np.nan), unknown, status)


def test_fixes_are_scored_with_what_was_refused(truth: Truth, moved: Moved) -> None:
    xy_m = moved(truth, WHERE)[:, :2].copy()
    xy_m[[0, 4]] += [0, 2.0]
    xy_m[2:4] += [0.5, 0]
    summary = scoring.fix_errors(planted_fixes(xy_m, truth.t_s), truth, WHERE)
    assert summary.ambiguous.median_m == pytest.approx(2.0)
    assert summary.ambiguous.count == 2
    assert summary.ok.count == truth.t_s.size - 4
    assert summary.ok.maximum_m == pytest.approx(0.5)
    assert summary.ok.median_m < 1e-9
    told = {"OK": truth.t_s.size - 4, "AMBIGUOUS": 2, "UNKNOWN_PLACE": 1, "NO_ECHO": 1}
    assert summary.by_status == told | {"SUSPECT": 0}
    assert summary.coverage == pytest.approx((truth.t_s.size - 4) / truth.t_s.size)


def test_fixes_at_waypoints_are_interpolated(truth: Truth, waypoints: Truth, moved: Moved) -> None:
    later = truth.t_s[:-1] + 0.2
    poses = moved(truth, WHERE)
    xy_m = poses[:-1, :2] + (poses[1:, :2] - poses[:-1, :2]) * (0.2 / np.diff(truth.t_s))[:, None]
    summary = scoring.fix_errors(planted_fixes(xy_m, later), waypoints, WHERE)
    assert summary.ok.count == waypoints.t_s.size - 1  # the first waypoint precedes all fixes
    assert summary.ok.median_m < 0.01


def test_a_waypoint_beside_an_ambiguous_fix_is_ambiguous(truth: Truth, waypoints: Truth) -> None:
    later = truth.t_s[3:] + 0.2  # fix 4 comes just after the waypoint of row 7
    fixes = planted_fixes(truth.world_from_body[3:, :2], later)
    summary = scoring.fix_errors(fixes, waypoints, WHERE)
    assert summary.ambiguous.count == 1
    assert summary.ok.count == waypoints.t_s.size - 2


def test_fixes_outside_the_truth_are_counted_but_not_scored(truth: Truth) -> None:
    later = truth.t_s[-1] + 1 + np.arange(6.0)
    summary = scoring.fix_errors(planted_fixes(np.zeros((6, 2)), later), truth, WHERE)
    assert summary.ok.count == 0
    assert summary.by_status["OK"] == 2


def test_nothing_is_forgiven_where_the_start_was_declared(truth: Truth, moved: Moved) -> None:
    poses = moved(truth, WHERE)
    apart = np.linalg.norm(poses[:, :2] - truth.world_from_body[:, :2], axis=1)
    errors = scoring.placed_errors(truth.t_s, poses, truth, scoring.AS_DECLARED)
    np.testing.assert_allclose(errors, apart)
    back = scoring.placement(scoring.match(truth.t_s, poses, truth), Alignment.ALIGNED)
    same = scoring.SimilarityTransform(back.world_from_map)
    assert scoring.placed_errors(truth.t_s, poses, truth, same).max() < 1e-9


T_S = np.arange(0.0, 50.0, 5.0)


def there_and_back() -> Truth:
    """Nodes 0 to 4 walk out 2 m each, nodes 5 to 9 come back 0.5 m beside."""
    x = np.concatenate([np.arange(5) * 2.0, np.arange(4, -1, -1) * 2.0])
    y = np.repeat([0.0, 0.5], 5)
    return Truth(T_S, np.column_stack([x, y, np.repeat([0, np.pi], 5)]))


def closures(*pairs: tuple[int, int]) -> Closures:
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    size = i.size
    return Closures(i, j, np.ones(size), np.zeros((size, 3)), np.zeros((size, 3, 3)))


def test_right_and_wrong_closures_are_told_apart() -> None:
    score = score_closures(closures((0, 9), (1, 8), (2, 6)), T_S, there_and_back())
    assert score.right.tolist() == [True, True, False]
    assert np.allclose(score.distance_m, [0.5, 0.5, np.hypot(2 * 1.0, 0.5)])
    assert score.precision == pytest.approx(2 / 3)
    assert score.median_distance_m == pytest.approx(0.5)


def test_recall_counts_returning_nodes() -> None:
    """Node 5 comes 5 s after node 4, too soon to be a return; 6, 7, 8 and 9 return."""
    score = score_closures(closures((0, 9), (1, 8), (2, 6)), T_S, there_and_back())
    assert score.recall == pytest.approx(2 / 4)
    sooner = score_closures(closures((0, 9)), T_S, there_and_back(), revisit_s=5.0)
    assert sooner.recall == pytest.approx(1 / 5)


def test_the_radius_decides() -> None:
    strict = score_closures(closures((0, 9)), T_S, there_and_back(), radius_m=0.4)
    assert strict.precision == 0
    assert np.isnan(strict.recall)


def test_closures_outside_the_truth_are_not_judged() -> None:
    dense = there_and_back()
    part = Truth(dense.t_s[:9], dense.world_from_body[:9])
    score = score_closures(closures((0, 9), (1, 8)), T_S, part)
    assert score.count == 1
    assert score.precision == 1
    assert np.isnan(score.distance_m[0])


def test_no_closures_have_no_precision() -> None:
    score = score_closures(closures(), T_S, there_and_back())
    assert score.count == 0
    assert np.isnan(score.precision)
    assert np.isnan(score.median_distance_m)
    assert score.recall == 0


def mean(values: np.ndarray) -> float:
    return float(values.mean())


def test_same_seed_same_interval() -> None:
    walks = [np.arange(5.0), np.arange(9.0), np.ones(3)]
    first = interval(walks, mean, np.random.default_rng(3))
    assert first == interval(walks, mean, np.random.default_rng(3))
    assert first[0] < mean(np.concatenate(walks)) < first[1]


def test_one_walk_gives_its_own_value() -> None:
    assert interval([np.array([1.0, 3.0])], mean, np.random.default_rng(0)) == (2, 2)


def test_walks_are_drawn_not_footsteps() -> None:
    """A thousand equal footsteps in each of ten walks tell no more than ten numbers."""
    values = np.random.default_rng(1).normal(0, 1, 10)
    low, high = interval([np.full(1000, v) for v in values], mean, np.random.default_rng(0))
    few = interval([np.array([v]) for v in values], mean, np.random.default_rng(0))
    assert (low, high) == pytest.approx(few)
    assert high - low > 0.5


def test_about_95_percent_of_intervals_cover() -> None:
    """Ninety is what a percentile interval of 25 walks should at least reach (seeds 0 to 39)."""
    covered = 0
    for seed in range(40):
        generator = np.random.default_rng(seed)
        low, high = interval(list(generator.normal(5, 2, (25, 1))), mean, generator)
        covered += low <= 5 <= high
    assert 35 <= covered < 40


def test_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="no values"):
        interval([np.empty(0)], mean, np.random.default_rng(0))


def test_a_row_per_method_and_alignment(run: Run, truth: Truth) -> None:
    rows = scoring.run_scores(run, truth)
    keys = [(row["method"], row["alignment"]) for row in rows]
    kinds = ["anchored", "aligned", "aligned with scale"]
    assert keys == [(method, kind) for method in ("dead reckoning", "SLAM") for kind in kinds]
    walk = run.trajectory
    errors = position_errors(walk.t_s, walk.world_from_body, truth, Alignment.ALIGNED)
    assert rows[4]["median_m"] == summarise(errors).median_m
    assert [row["end_error_share"] is None for row in rows] == [False, True, True] * 2


def test_rows_are_json(run: Run, truth: Truth) -> None:
    unknown = np.full(1, np.nan)
    refused = Fixes([3.0], [[np.nan, np.nan]], unknown, np.full((1, 2, 2), np.nan), unknown, [2])
    rows = [*scoring.run_scores(run, truth), *scoring.closure_scores(run, truth)]
    fixes = scoring.fix_scores(refused, truth, np.zeros(3))
    assert json.loads(json.dumps([*rows, *fixes], allow_nan=False)) == [*rows, *fixes]
    assert fixes[0]["median_m"] is None
    none = dict.fromkeys(["OK", "AMBIGUOUS", "NO_ECHO", "SUSPECT"], 0)
    assert fixes[0]["by_status"] == none | {"UNKNOWN_PLACE": 1}


def test_planted_wrong_closures_lower_the_precision_until_the_graph_rejects_them(
    run: Run, truth: Truth
) -> None:
    found, kept = scoring.closure_scores(run, truth)
    count = run.closures.i.size
    assert found["precision"] == pytest.approx((count - 2) / count)
    kept_count = int((run.trajectory.closure_weights > 0.5).sum())
    assert (found["count"], kept["count"]) == (count, kept_count)


STEPS = 150
STEP_M = 0.7
START = np.zeros(3)
STILL = np.zeros(3)


def planted(seed, step_sigma=STILL, scale_sigma=0.0, drift_radps=0.0, said=1.0):
    """A walk of a few turns and its odometry, wrong by what it says (or `said` times that)."""
    generator = np.random.default_rng(seed)
    moves = np.column_stack([np.full(STEPS, STEP_M), np.zeros(STEPS), np.zeros(STEPS)])
    moves[[40, 80, 110], 2] = [1.2, -0.8, 1.5]
    t_s = 0.5 * np.arange(STEPS + 1)
    wrong = moves + step_sigma * generator.standard_normal(moves.shape)
    wrong[:, :2] *= 1 + scale_sigma * generator.standard_normal()
    wrong[:, 2] += drift_radps * 0.5 * generator.standard_normal()
    sigma = np.tile(np.maximum(step_sigma, 1e-4) * said, (STEPS, 1))
    odometry = Odometry(t_s, chain(START, wrong), sigma, said * scale_sigma, said * drift_radps)
    return odometry, Truth(t_s, chain(START, moves))


def all_errors(distance_m, **options):
    found = [displacement_errors(*planted(seed, **options), distance_m) for seed in range(60)]
    return Displacements(
        np.vstack([one.error_m for one in found]),
        np.vstack([one.sigma_m for one in found]),
        np.concatenate([one.nees for one in found]),
    )


@pytest.mark.parametrize("distance_m", [5.0, 20.0, 60.0])
@pytest.mark.parametrize(
    "wrong",
    [
        {"step_sigma": np.array([0.2, 0.1, 0.01])},
        {"step_sigma": np.array([0.05, 0.05, 0.001]), "scale_sigma": 0.08},
        {"step_sigma": np.array([0.05, 0.05, 0.001]), "drift_radps": 0.002},
    ],
    ids=["steps", "scale", "drift"],
)
def test_right_sigmas_give_two_in_the_mean(distance_m, wrong):
    found = all_errors(distance_m, **wrong)
    assert len(found.nees) > 200
    assert found.nees.mean() == pytest.approx(2.0, abs=0.6)
    within = np.abs(found.error_m) < found.sigma_m
    assert within.mean() == pytest.approx(0.68, abs=0.08)


def test_sigmas_half_as_large_give_four_times_as_much():
    steps = {"step_sigma": np.array([0.2, 0.1, 0.01])}
    right, bold = all_errors(20.0, **steps), all_errors(20.0, **steps, said=0.5)
    assert bold.nees.mean() == pytest.approx(4 * right.nees.mean(), rel=0.01)
    np.testing.assert_allclose(bold.error_m, right.error_m)


def test_a_wrong_scale_errs_along_and_a_drift_across():
    odometry, truth = planted(0)
    longer = Odometry(odometry.t_s, odometry.world_from_body * [1.1, 1.1, 1.0], odometry.step_sigma)
    found = displacement_errors(longer, truth, 20.0)
    straight = np.abs(found.error_m[:, 1]) < 0.01
    assert straight.all()
    assert (found.error_m[:, 0] > 0.5).all()


def test_waypoints_count_with_their_own_error():
    odometry, dense = planted(1, step_sigma=np.array([0.2, 0.1, 0.01]))
    poses = dense.world_from_body[::8].copy()
    poses[:, 2] = np.nan
    waypoints = Truth(dense.t_s[::8], poses)
    sure, doubted = (displacement_errors(odometry, waypoints, 20.0, m) for m in (0.0, 0.5))
    assert len(sure.nees) > 5
    assert (doubted.sigma_m > sure.sigma_m).all()
    assert (doubted.sigma_m[:, 0] ** 2 - sure.sigma_m[:, 0] ** 2) == pytest.approx(0.5)


def test_a_short_walk_has_none():
    odometry, truth = planted(0)
    assert len(displacement_errors(odometry, truth, 500.0).nees) == 0
