"""Closures by sequence: planted ridges are found, and what contradicts dead reckoning is not."""

import dataclasses
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base import values
from elfslam.base.arrays import F32, F64
from elfslam.base.geometry import between, chain, compose, wrap_angle
from elfslam.base.values import NO_CLOSURES, Closures, Features, Odometry, Similarity
from elfslam.stages import closure

PARAMETERS = closure.ClosureParameters()
HALF = PARAMETERS.half_sequence
BOTH_WAYS = dataclasses.replace(PARAMETERS, back_margin=0.0)
STEP_M = 0.7
SIDE = 12
LAP = 4 * SIDE
SIGMA = (0.05, 0.05, 0.01)
Line = tuple[int, int, int, float]
"""First and last row, the column in the first, and the slope."""


def square_walk(laps: float, drift_rad: float = 0.0) -> Odometry:
    """Rounds of a square of 12 steps a side, left about."""
    count = round(laps * LAP)
    moves = np.zeros((count, 3))
    moves[:, 0] = STEP_M
    moves[SIDE - 1 :: SIDE, 2] = np.pi / 2
    moves[:, 2] += drift_rad
    return odometry(moves)


def there_and_back(steps: int) -> Odometry:
    """Straight ahead, a turn on the spot, and straight back."""
    moves = np.zeros((2 * steps + 1, 3))
    moves[:, 0] = STEP_M
    moves[steps] = [0.0, 0.0, np.pi]
    return odometry(moves)


def odometry(moves: F64) -> Odometry:
    poses = chain(np.zeros(3), moves)
    return Odometry(0.5 * np.arange(len(poses)), poses, np.tile(SIGMA, (len(moves), 1)))


def alike(count: int, lines: Sequence[Line], height: float = 0.8, seed: int = 4) -> Similarity:
    """Scores with ridges along `lines`, symmetric, over a noisy floor."""
    generator = np.random.default_rng(seed)
    scores = generator.normal(0.1, 0.05, (count, count))
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    for first, last, column, slope in lines:
        away = np.abs(j - (column + slope * (i - first)))
        ridge = height - 0.25 * away
        scores = np.where((i >= first) & (i <= last), np.maximum(scores, ridge), scores)
    lower = np.tril(np.ones((count, count), bool))
    scores = np.where(lower, scores.T, scores)
    return Similarity(scores.astype(np.float32), "planted")


def pairs(found: Closures) -> set[tuple[int, int]]:
    return set(zip(found.i.tolist(), found.j.tolist(), strict=True))


def test_a_second_round_closes_each_footstep_with_its_own() -> None:
    nodes = square_walk(2)
    found = closure.find_closures(alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)]), nodes, PARAMETERS)
    inner = {(k, k + LAP) for k in range(HALF, LAP - HALF)}
    assert inner <= pairs(found) <= {(k, k + LAP) for k in range(LAP)}
    npt.assert_allclose(found.i_from_j, 0, atol=0.15 * STEP_M)
    assert (found.score > PARAMETERS.threshold).all()


def test_walking_back_gives_half_a_turn_and_the_right_place() -> None:
    nodes = there_and_back(30)
    # Stretch k leads from k to k+1, so on the way back stretch 60 - k lies on it.
    found = closure.find_closures(alike(61, [(0, 25, 60, -1.0)]), nodes, BOTH_WAYS)
    assert pairs(found) >= {(k, 60 - k) for k in range(HALF, 22)}
    truth = between(nodes.world_from_body[found.i], nodes.world_from_body[found.j])
    npt.assert_allclose(found.i_from_j[:, :2], truth[:, :2], atol=0.2 * STEP_M)
    npt.assert_allclose(wrap_angle(found.i_from_j[:, 2] - truth[:, 2]), 0, atol=1e-9)


def test_a_stretch_walked_back_must_be_more_alike() -> None:
    back = alike(61, [(0, 25, 60, -1.0)])
    found = closure.find_closures(back, there_and_back(30), BOTH_WAYS)
    lowest, highest = found.score.min(), found.score.max()
    loose, strict = (
        dataclasses.replace(PARAMETERS, back_margin=level - PARAMETERS.threshold)
        for level in (lowest - 0.01, highest + 0.01)
    )
    assert pairs(closure.find_closures(back, there_and_back(30), loose)) == pairs(found)
    assert len(closure.find_closures(back, there_and_back(30), strict).i) == 0
    again = alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)])
    assert len(closure.find_closures(again, square_walk(2), strict).i) > LAP / 2


@pytest.mark.parametrize("ahead", [-0.4, 0.3])
def test_a_partner_between_two_footsteps_lies_ahead_or_behind(ahead: float) -> None:
    found = closure.find_closures(alike_between(2 * LAP, LAP + ahead), square_walk(2), PARAMETERS)
    npt.assert_allclose(np.median(found.i_from_j[:, 0]), -ahead * STEP_M, atol=0.1 * STEP_M)


def alike_between(count: int, offset: float) -> Similarity:
    """The ridge of a second pass whose footsteps fall `offset` columns on."""
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    away = np.minimum(np.abs(j - i - offset), np.abs(i - j - offset))
    return Similarity(np.maximum(0.8 - 0.2 * away**2, 0.0), "planted")


def test_scattered_similarity_closes_nothing() -> None:
    """High scores here and there, as many as footsteps, but no two in sequence."""
    scores = alike(2 * LAP, []).scores.copy()
    generator = np.random.default_rng(3)
    i, j = generator.integers(0, 2 * LAP, (2, 2 * LAP))
    scores[i, j] = scores[j, i] = 0.75
    assert len(closure.find_closures(Similarity(scores, "x"), square_walk(2), PARAMETERS).i) == 0


def test_dead_reckoning_rules_out_what_it_cannot_have_missed() -> None:
    """The far side of the square sounds the same for a whole side."""
    lines = [(2, SIDE - 2, 2 + 2 * SIDE, 1.0)]
    assert len(closure.find_closures(alike(2 * LAP, lines), square_walk(2), PARAMETERS).i) == 0
    blind = dataclasses.replace(PARAMETERS, gate_probability=1.0)
    assert len(closure.find_closures(alike(2 * LAP, lines), square_walk(2), blind).i) > 5


def test_one_cannot_be_at_two_places_at_once() -> None:
    """A pillar further on sounds nearly as the right one: dead reckoning alone cannot tell."""
    nodes = uncertain(square_walk(2))
    right, wrong = (0, LAP - 1, LAP, 1.0), (0, LAP - 5, LAP + 4, 1.0)
    both = np.maximum(alike(2 * LAP, [right], 0.8).scores, alike(2 * LAP, [wrong], 0.7).scores)
    found = closure.find_closures(Similarity(both, "x"), nodes, PARAMETERS)
    assert {j - i for i, j in pairs(found)} == {LAP}
    loose = dataclasses.replace(PARAMETERS, rival_margin=0.0)
    again = closure.find_closures(Similarity(both, "x"), nodes, loose)
    assert {j - i for i, j in pairs(again)} == {LAP}


def test_where_two_places_sound_the_same_neither_is_taken() -> None:
    nodes = uncertain(square_walk(2))
    twins = [(0, LAP - 1, LAP, 1.0), (0, LAP - 7, LAP + 6, 1.0)]
    found = closure.find_closures(alike(2 * LAP, twins), nodes, PARAMETERS)
    alone = closure.find_closures(alike(2 * LAP, twins[:1]), nodes, PARAMETERS)
    assert len(found.i) < 0.35 * len(alone.i)
    assert all(i > LAP - 12 or i < 8 for i, _ in pairs(found)), "only where one of them ends"


def uncertain(nodes: Odometry) -> Odometry:
    """The same walk by someone whose steps say little."""
    sigma = np.tile([0.15, 0.15, 0.05], (len(nodes.t_s) - 1, 1))
    return dataclasses.replace(nodes, step_sigma=sigma)


def test_two_equal_corridors_are_not_one() -> None:
    """Up a corridor, over, and up another that sounds the same: no closure, ever."""
    ahead, left = [STEP_M, 0.0, 0.0], [STEP_M, 0.0, np.pi / 2]
    right = [STEP_M, 0.0, -np.pi / 2]
    moves = [ahead] * 29 + [right] + [ahead] * 15 + [right] + [ahead] * 29
    moves += [left] + [ahead] * 15 + [left] + [ahead] * 29
    nodes = odometry(np.array(moves))
    second = 29 + 1 + 15 + 1 + 29 + 1 + 15 + 1
    twin = [(0, 28, second, 1.0)]
    assert len(closure.find_closures(alike(len(moves), twin), nodes, PARAMETERS).i) == 0


def test_a_third_round_closes_with_both_before() -> None:
    lines = [(0, 2 * LAP - 1, LAP, 1.0), (0, LAP - 1, 2 * LAP, 1.0)]
    found = closure.find_closures(alike(3 * LAP, lines), square_walk(3), PARAMETERS)
    offsets = np.bincount(found.j - found.i)
    assert offsets[LAP] > 1.7 * LAP
    assert offsets[2 * LAP] > 0.7 * LAP
    assert offsets.sum() == offsets[LAP] + offsets[2 * LAP]


def test_neighbours_in_time_are_no_closures() -> None:
    scores = alike(2 * LAP, [(0, LAP, 5, 1.0)])
    far = dataclasses.replace(PARAMETERS, gate_probability=1.0)
    assert len(closure.find_closures(scores, square_walk(2), far).i) == 0
    near = dataclasses.replace(far, near_footsteps=4)
    assert len(closure.find_closures(scores, square_walk(2), near).i) > LAP / 2


def test_the_covariance_is_that_of_the_parameters() -> None:
    sigmas = {"along_sigma_m": 0.1, "across_sigma_m": 0.2, "heading_sigma_rad": 0.3}
    known = dataclasses.replace(PARAMETERS, sigma_fall=0.0, **sigmas)
    found = closure.find_closures(alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)]), square_walk(2), known)
    assert len(found.i) > 0
    stated = np.tile(np.diag([0.01, 0.04, 0.09]), (len(found.i), 1, 1))
    npt.assert_allclose(found.covariance, stated)


def test_the_more_alike_the_nearer() -> None:
    """Sigmas are as stated a little above the threshold, and fall by the rate from there."""
    usual = PARAMETERS.threshold + closure.USUAL_LEAD
    sigmas = []
    for height in (usual, usual + 0.05, 0.9):
        planted = alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)], height=height)
        found = closure.find_closures(planted, square_walk(2), PARAMETERS)
        middle = np.argmin(np.abs(found.score - height) + (found.i < HALF))
        sigmas.append(np.sqrt(found.covariance[middle, 1, 1]) / PARAMETERS.across_sigma_m)
    npt.assert_allclose(sigmas[:2], np.exp([0.0, -0.05 * PARAMETERS.sigma_fall]), rtol=0.05)
    assert sigmas[2] == closure.LEAST_SIGMA_SHARE


def test_blocks_of_rows_give_what_the_whole_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    nodes, generator = square_walk(4), np.random.default_rng(1)
    places = generator.standard_normal((LAP, 16))
    means = np.tile(places / np.linalg.norm(places, axis=1, keepdims=True), (4, 1))
    means = (means + 0.1 * generator.standard_normal(means.shape)).astype(np.float32)
    whole = closure.find_closures(Similarity(means @ means.T, "x"), nodes, PARAMETERS)
    monkeypatch.setattr(closure, "_block_rows", lambda count: 17)
    parts = closure.find_closures(values.MeanSimilarity(means, "x"), nodes, PARAMETERS)
    assert pairs(parts) == pairs(whole)
    assert len(whole.i) > 4 * LAP
    order, other = np.lexsort((whole.j, whole.i)), np.lexsort((parts.j, parts.i))
    npt.assert_allclose(parts.score[other], whole.score[order], rtol=1e-5)
    npt.assert_allclose(parts.i_from_j[other], whole.i_from_j[order], atol=1e-3)


@pytest.mark.parametrize("direction", [closure.AGAIN, closure.BACK])
def test_the_sequence_mean_is_the_naive_one(direction: int) -> None:
    scores: F32 = np.random.default_rng(0).random((7, 9)).astype(np.float32)
    got = closure.sequence_mean(scores, 2, direction)
    for i in range(7):
        for j in range(9):
            along = [(i + k, j + k * direction) for k in range(-2, 3)]
            inside = [scores[a, b] for a, b in along if 0 <= a < 7 and 0 <= b < 9]
            assert got[i, j] == pytest.approx(np.mean(inside), rel=1e-5)


def prior(log_odds: float, gain: float) -> closure.Prior:
    return lambda asked: (np.full(len(asked.i), log_odds), np.full(len(asked.i), gain))


def test_what_a_solution_expects_may_be_less_alike() -> None:
    nodes = square_walk(2)
    faint = alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)], height=PARAMETERS.threshold - 0.04)
    assert len(closure.find_closures(faint, nodes, PARAMETERS).i) == 0
    found = closure.guided_closures(faint, nodes, NO_CLOSURES, prior(5.0, 3.0), PARAMETERS)
    assert len(found.i) > LAP / 2
    assert (np.abs(found.j - found.i - LAP) <= 1).all()
    assert (found.covariance[:, 0, 0] > PARAMETERS.along_sigma_m**2).all()


@pytest.mark.parametrize(("log_odds", "gain"), [(0.5, 3.0), (-np.inf, 3.0), (5.0, 0.5)])
def test_what_earns_or_tells_too_little_is_no_closure(log_odds: float, gain: float) -> None:
    nodes = square_walk(2)
    faint = alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)], height=PARAMETERS.threshold - 0.04)
    found = closure.guided_closures(faint, nodes, NO_CLOSURES, prior(log_odds, gain), PARAMETERS)
    assert len(found.i) == 0


def test_guided_matching_finds_nothing_twice() -> None:
    nodes = square_walk(2)
    clear = alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)])
    known = closure.find_closures(clear, nodes, PARAMETERS)
    further = closure.guided_closures(clear, nodes, known, prior(5.0, 3.0), PARAMETERS)
    assert len(known.i) > LAP / 2
    assert not pairs(known) & pairs(further)


def test_no_similarity_or_a_single_footstep_closes_nothing() -> None:
    nodes = Odometry([0.0, 0.5], np.zeros((2, 3)), np.ones((1, 3)))
    found = closure.find_closures(Similarity(np.ones((1, 1)), "stub"), nodes, PARAMETERS)
    assert (len(found.i), found.covariance.shape) == (0, (0, 3, 3))
    blank = values.MeanSimilarity(np.zeros((2 * LAP, 1)), "blank")
    assert len(closure.find_closures(blank, square_walk(2), PARAMETERS).i) == 0


def test_closures_that_lie_together_weigh_as_one() -> None:
    i, j = np.array([10, 12, 14, 40]), np.array([60, 61, 62, 90])
    covariance = np.tile(np.diag([1.0, 2.0, 3.0]), (4, 1, 1))
    alone = Closures(i, j, np.ones(4), np.zeros((4, 3)), covariance)
    together = closure.sharing_errors(alone, 4)
    npt.assert_allclose(together.covariance[:3], 3 * alone.covariance[:3])
    npt.assert_array_equal(together.covariance[3], alone.covariance[3])
    information = np.linalg.inv(together.covariance[:3]).sum(axis=0)
    npt.assert_allclose(information, np.diag([1, 1 / 2, 1 / 3]))
    npt.assert_array_equal(closure.sharing_errors(alone, 1).covariance, alone.covariance)
    far = dataclasses.replace(alone, j=np.array([60, 80, 100, 120]))
    npt.assert_array_equal(closure.sharing_errors(far, 4).covariance, alone.covariance)
    assert len(closure.sharing_errors(NO_CLOSURES, 4).i) == 0


def test_no_loop_closes_while_setting_off_or_stopping() -> None:
    again = alike(2 * LAP, [(0, LAP - 1, LAP, 1.0)])
    found = closure.find_closures(again, square_walk(2), PARAMETERS)
    assert found.i.min() == HALF
    assert found.j.max() == 2 * LAP - 1 - HALF


COUNT = 40
STEP_S = 0.5
STEP_SIGMA = np.array([0.03, 0.02, 0.01])


def curved_moves() -> F64:
    turn_rad = 0.08 * np.sin(np.arange(COUNT) / 5) + 0.03
    return np.column_stack([np.full(COUNT, 0.7), np.zeros(COUNT), turn_rad])


def walk(moves: F64, start: tuple[float, float, float] = (3.0, -2.0, 0.4)) -> Odometry:
    poses = chain(np.array(start), moves)
    return Odometry(STEP_S * np.arange(len(moves) + 1), poses, np.tile(STEP_SIGMA, (len(moves), 1)))


def scattered_ends(scale_sigma: float, turn_sigma_radps: float, i: int, j: int) -> F64:
    """Errors (k, 3) of the way from node i to node j, in the axes of the walk, of many walkers."""
    generator = np.random.default_rng(5)
    moves, clean = curved_moves()[i:j], walk(curved_moves()).world_from_body
    ends = []
    for _ in range(4000):
        noisy = moves + generator.normal(0, STEP_SIGMA, moves.shape)
        noisy[:, :2] *= 1 + scale_sigma * generator.normal()
        noisy[:, 2] += STEP_S * turn_sigma_radps * generator.normal()
        ends.append(chain(clean[i], noisy)[-1] - clean[j])
    errors = np.array(ends)
    errors[:, 2] = wrap_angle(errors[:, 2])
    return errors


@pytest.mark.parametrize(("i", "j"), [(0, 40), (7, 31), (12, 13)])
@pytest.mark.parametrize(("scale_sigma", "turn_sigma_radps"), [(0, 0), (0.05, 0), (0.02, 0.004)])
def test_the_covariance_is_that_of_many_walkers(
    i: int, j: int, scale_sigma: float, turn_sigma_radps: float
) -> None:
    wanted = np.cov(scattered_ends(scale_sigma, turn_sigma_radps, i, j).T)
    wrong = {"scale_sigma": scale_sigma, "heading_drift_sigma_radps": turn_sigma_radps}
    nodes = replace(walk(curved_moves()), **wrong)
    got = closure.Drift(nodes).covariances(np.array([i]), np.array([j]))[0]
    npt.assert_allclose(got, wanted, atol=0.12 * np.abs(np.diag(wanted)).max())
    npt.assert_allclose(np.diag(got), np.diag(wanted), rtol=0.12)


def test_no_way_has_no_drift() -> None:
    same = np.array([0, 9])
    npt.assert_allclose(closure.Drift(walk(curved_moves())).covariances(same, same), 0, atol=1e-15)


def test_moving_the_world_changes_no_disagreement() -> None:
    moves = curved_moves()
    i, j = np.array([0, 3, 10]), np.array([20, 15, 39])
    slack = np.array([0.3, 0.3, 0.2])
    here = closure.Drift(walk(moves)).disagreement(i, j, 0.1, slack)
    far = closure.Drift(walk(moves, (4000.0, -9000.0, 2.5))).disagreement(i, j, 0.1, slack)
    npt.assert_allclose(far, here, rtol=1e-6)


def test_the_disagreement_is_the_squared_mahalanobis_distance() -> None:
    nodes, slack = walk(curved_moves()), np.array([0.2, 0.2, 0.2])
    drift = closure.Drift(nodes)
    i, j = np.array([2]), np.array([30])
    way = nodes.world_from_body[30] - nodes.world_from_body[2]
    way[2] = wrap_angle(way[2] - np.pi)
    covariance = drift.covariances(i, j)[0] + np.diag(slack**2)
    wanted = way @ np.linalg.inv(covariance) @ way
    npt.assert_allclose(drift.disagreement(i, j, np.pi, slack), [wanted])


def test_who_comes_back_agrees_and_who_went_on_does_not() -> None:
    """A square walked once and a bit more, and a straight walk of the same length."""
    side = np.zeros((10, 3))
    side[:, 0] = 0.7
    side[-1, 2] = np.pi / 2
    square, straight = walk(np.tile(side, (4, 1))), walk(np.tile(side[:1], (40, 1)))
    ends, slack = (np.array([0]), np.array([40])), np.array([0.3, 0.3, 0.3])
    assert closure.Drift(square).disagreement(*ends, 0.0, slack)[0] < 1
    assert closure.Drift(straight).disagreement(*ends, 0.0, slack)[0] > 100
    back = compose(between(square.world_from_body[0], square.world_from_body[0]), np.zeros(3))
    npt.assert_allclose(back, 0, atol=1e-12)


FOOTSTEPS_S = np.array([1.0, 1.5, 2.1, 2.2, 3.0, 3.5])


def features(count: int = 40, seed: int = 0) -> Features:
    """Unit vectors every 0.1 s, from before the first to after the last footstep."""
    generator = np.random.default_rng(seed)
    vectors = generator.normal(size=(count, 8)) + 0.5
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return Features(0.03 + 0.1 * np.arange(count), vectors.astype(np.float32), "stub")


def nodes(t_s: np.ndarray = FOOTSTEPS_S) -> Odometry:
    count = len(t_s)
    return Odometry(t_s, np.zeros((count, 3)), np.ones((count - 1, 3)))


def test_ess_is_the_mean_of_the_pairwise_cosines() -> None:
    given = features()
    t_s, spans = given.t_s, pairwise(FOOTSTEPS_S)
    of_footstep = [given.vectors[(t_s >= a) & (t_s < b)] for a, b in spans]
    naive = [[np.mean(left @ right.T) for right in of_footstep] for left in of_footstep]
    similarity = closure.echo_sequence_similarity(given, nodes())
    npt.assert_allclose(similarity.scores, naive, atol=1e-5)
    npt.assert_array_equal(similarity.scores, similarity.scores.T)
    assert similarity.kind == "elf:stub"


def test_an_echo_on_a_footstep_belongs_to_the_stretch_that_begins_there() -> None:
    on = Features(FOOTSTEPS_S, np.eye(6, dtype=np.float32), "stub")
    npt.assert_array_equal(closure.footstep_means(on, FOOTSTEPS_S), np.eye(6)[:5])


def test_means_are_not_normalised() -> None:
    opposite = np.array([[1, 0], [-1, 0], [0, 1]], dtype=np.float32)
    given = Features(np.array([1.1, 1.2, 1.6]), opposite, "stub")
    npt.assert_array_equal(closure.footstep_means(given, FOOTSTEPS_S)[:2], [[0, 0], [0, 1]])


def test_a_footstep_without_echoes_resembles_nothing() -> None:
    given = features()
    keep = (given.t_s < 1.5) | (given.t_s >= 2.1)
    sparse = Features(given.t_s[keep], given.vectors[keep], "stub")
    scores = closure.echo_sequence_similarity(sparse, nodes()).scores
    assert not scores[1].any()
    assert not scores[:, 1].any()
    assert scores[0, 0] > 0
    assert scores[3, 4] != 0


def test_echoes_outside_the_walk_do_not_count() -> None:
    given = features()
    inside = (given.t_s >= FOOTSTEPS_S[0]) & (given.t_s < FOOTSTEPS_S[-1])
    cropped = Features(given.t_s[inside], given.vectors[inside], "stub")
    npt.assert_array_equal(
        closure.echo_sequence_similarity(given, nodes()).scores,
        closure.echo_sequence_similarity(cropped, nodes()).scores,
    )
