"""Closures: planted lines are found, everything else is not."""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.geometry import chain, compose, wrap_angle
from elfslam.base.values import Closures, Odometry, Similarity
from studies.curation import CurationParameters, candidate_pairs, curated_closures

PARAMETERS = CurationParameters()
STEP_M = 0.7
COUNT = 100
Partner = Callable[[F64], F64]


def planted(partner: Partner, first: int, last: int, *, width: float = 1.1) -> F32:
    """Scores (100, 100): footsteps `first` to `last` resemble the partner's, both ways round."""
    scores = np.zeros((COUNT, COUNT), dtype=np.float32)
    i, j = np.meshgrid(np.arange(first, last), np.arange(COUNT), indexing="ij")
    distance = np.abs(j - partner(i.astype(float)))
    near = distance < width
    scores[i[near], j[near]] = 0.9 - 0.2 * distance[near]
    return np.asarray(np.maximum(scores, scores.T))


def noisy(scores: F32, share: float = 0.01) -> F32:
    """The same with scattered places that only sound alike."""
    generator = np.random.default_rng(4)
    alike = np.triu(generator.random(scores.shape) < share, k=1)
    return np.asarray(np.where(alike | alike.T, np.float32(0.8), scores))


def walk(step_m: F64 | float = STEP_M) -> Odometry:
    """Straight ahead."""
    moves = np.zeros((COUNT, 3))
    moves[:, 0] = step_m
    poses = chain(np.zeros(3), moves)
    return Odometry(0.5 * np.arange(COUNT + 1), poses, np.full((COUNT, 3), 0.1))


def closures_of(scores: F32, nodes: Odometry | None = None, **changes: float) -> Closures:
    parameters = dataclasses.replace(PARAMETERS, **changes)
    return curated_closures(Similarity(scores, "stub"), nodes or walk(), parameters)


def same_way(offset: float) -> Partner:
    return lambda i: i + offset


def test_two_passes_give_exactly_the_planted_line() -> None:
    scores = noisy(planted(same_way(50), 5, 45))
    found = closures_of(scores)
    npt.assert_array_equal(found.i, np.arange(5, 45))
    npt.assert_array_equal(found.j, np.arange(55, 95))
    npt.assert_array_equal(found.score, scores[found.i, found.j])
    npt.assert_allclose(found.i_from_j, np.zeros((40, 3)), atol=0.15 * STEP_M)


def test_scattered_points_alone_close_nothing() -> None:
    blank = noisy(np.zeros((COUNT, COUNT), dtype=np.float32), share=0.03)
    assert len(candidate_pairs(blank, PARAMETERS)) > 100
    assert len(closures_of(blank).i) == 0


def test_walking_back_gives_half_a_turn_and_the_right_place() -> None:
    # Ahead for 40 steps and back again: stretch i is stretch 95 - i, walked the other way.
    found = closures_of(noisy(planted(lambda i: 95 - i, 5, 40)))
    pairs = set(zip(found.i.tolist(), found.j.tolist(), strict=True))
    assert pairs >= {(i, 95 - i) for i in range(8, 38)}
    there = np.column_stack([STEP_M * np.arange(48), np.zeros((48, 2))])
    back = np.column_stack([STEP_M * (96 - np.arange(48, 100)), np.zeros(52), np.full(52, np.pi)])
    truth = np.vstack([there, back])
    implied = compose(truth[found.i], found.i_from_j)
    npt.assert_allclose(implied[:, :2], truth[found.j][:, :2], atol=0.2 * STEP_M)
    npt.assert_allclose(wrap_angle(implied[:, 2] - truth[found.j][:, 2]), 0, atol=1e-9)


@pytest.mark.parametrize("pace", [0.8, 1.0, 1.25])
def test_a_partner_between_two_footsteps_lies_ahead_or_behind(pace: float) -> None:
    # The second pass takes `pace` times as many footsteps, so its steps are that much shorter.
    def partner(i: F64) -> F64:
        return pace * (i - 5) + 50.4

    steps = np.where(np.arange(COUNT) < 46, STEP_M, STEP_M / pace)
    found = closures_of(planted(partner, 5, 40, width=1.7), walk(steps))
    place_of_j_m = STEP_M * (5 + (found.j - 50.4) / pace)
    ahead_m = place_of_j_m - STEP_M * found.i
    error_m = found.i_from_j[:, 0] - ahead_m
    assert len(found.i) >= 30
    npt.assert_allclose(error_m, 0, atol=0.3 * STEP_M)
    npt.assert_array_equal(found.i_from_j[:, 1:], np.zeros((len(found.i), 2)))
    if pace != 1.0:
        assert np.corrcoef(found.i_from_j[:, 0], ahead_m)[0, 1] > 0.9
        assert np.ptp(ahead_m) > 0.5 * STEP_M


@pytest.mark.parametrize(("offset", "survives"), [(9, False), (15, True)])
def test_neighbours_in_time_are_no_closures(offset: int, survives: bool) -> None:
    scores = np.maximum(planted(same_way(offset), 5, 60), np.eye(COUNT, dtype=np.float32))
    found = closures_of(scores)
    assert bool(len(found.i)) is survives
    assert (found.j - found.i >= PARAMETERS.near_footsteps).all()


@pytest.mark.parametrize("triangle", [np.triu, np.tril])
def test_nothing_survives_without_its_mirror_image(triangle: Callable[[F32], F32]) -> None:
    whole = planted(same_way(50), 5, 45)
    assert len(closures_of(whole).i) == 40
    assert len(closures_of(triangle(whole)).i) == 0


@pytest.mark.parametrize(("slope", "width"), [(0.0, 0.5), (0.0, 1.1), (0.3, 1.1), (2.5, 1.1)])
def test_a_line_too_flat_or_too_steep_is_no_walk(slope: float, width: float) -> None:
    scores = planted(lambda i: 60 + slope * (i - 5), 5, 21, width=width)
    assert len(candidate_pairs(scores, PARAMETERS)) >= 32
    assert len(closures_of(scores).i) == 0


def test_one_closure_per_footstep_and_crossing_the_best() -> None:
    """A third pass closes with the first and the second."""
    scores = np.maximum(planted(same_way(30), 2, 26), planted(same_way(62), 2, 26))
    found = closures_of(scores)
    pairs = sorted(zip(found.i.tolist(), found.j.tolist(), strict=True))
    inner = [(i, j) for i, j in pairs if 2 < i < 25]
    assert inner == [(i, i + offset) for i in range(3, 25) for offset in (30, 62)]
    assert len(set(pairs)) == len(pairs)
    best = [scores[i, max(j - 2, 0) : j + 3].max() for i, j in zip(found.i, found.j, strict=True)]
    npt.assert_allclose(found.score, best)
