"""ESS is the mean of all pairwise cosines between two footsteps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.testing as npt

from elfslam.base.values import Features, Odometry
from elfslam.stages.similarity import echo_sequence_similarity, footstep_means

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
    of_footstep = [
        given.vectors[(given.t_s >= a) & (given.t_s < b)] for a, b in pairwise(FOOTSTEPS_S)
    ]
    naive = [
        [np.mean([u @ v for u in left for v in right]) for right in of_footstep]
        for left in of_footstep
    ]
    similarity = echo_sequence_similarity(given, nodes())
    npt.assert_allclose(similarity.scores, naive, atol=1e-5)
    npt.assert_array_equal(similarity.scores, similarity.scores.T)
    assert similarity.kind == "elf:stub"


def test_an_echo_on_a_footstep_belongs_to_the_stretch_that_begins_there() -> None:
    on = Features(FOOTSTEPS_S, np.eye(6, dtype=np.float32), "stub")
    npt.assert_array_equal(footstep_means(on, FOOTSTEPS_S), np.eye(6)[:5])


def test_means_are_not_normalised() -> None:
    opposite = np.array([[1, 0], [-1, 0], [0, 1]], dtype=np.float32)
    given = Features(np.array([1.1, 1.2, 1.6]), opposite, "stub")
    npt.assert_array_equal(footstep_means(given, FOOTSTEPS_S)[:2], [[0, 0], [0, 1]])


def test_a_footstep_without_echoes_resembles_nothing() -> None:
    given = features()
    keep = (given.t_s < 1.5) | (given.t_s >= 2.1)
    sparse = Features(given.t_s[keep], given.vectors[keep], "stub")
    scores = echo_sequence_similarity(sparse, nodes()).scores
    assert not scores[1].any()
    assert not scores[:, 1].any()
    assert scores[0, 0] > 0
    assert scores[3, 4] != 0


def test_echoes_outside_the_walk_do_not_count() -> None:
    given = features()
    inside = (given.t_s >= FOOTSTEPS_S[0]) & (given.t_s < FOOTSTEPS_S[-1])
    cropped = Features(given.t_s[inside], given.vectors[inside], "stub")
    npt.assert_array_equal(
        echo_sequence_similarity(given, nodes()).scores,
        echo_sequence_similarity(cropped, nodes()).scores,
    )
