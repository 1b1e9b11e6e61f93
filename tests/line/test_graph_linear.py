"""Sparse algebra of the back end against dense algebra, GTSAM and chance."""

from __future__ import annotations

import gtsam
import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64, I64
from elfslam.base.geometry import between, chain, compose, wrap_angle
from elfslam.base.values import PoseGraph
from elfslam.line.graph.blocks import (
    Pattern,
    factored,
    inverse_blocks,
    pattern_of,
    solution,
    stored_at,
)
from elfslam.line.graph.linear import (
    covariance_of,
    half_square,
    predicted_covariance,
    residuals,
    settle,
    uncertainty,
)
from elfslam.line.graph.solve import as_gtsam, as_values, rotation_first

ANCHOR = 1e-3


def some_pairs(generator: np.random.Generator, count: int) -> I64:
    onward = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    apart = generator.integers(0, count, (count, 2))
    return np.vstack([onward, apart[apart[:, 0] != apart[:, 1]]])


def positive_matrix(
    generator: np.random.Generator, pairs: I64, count: int
) -> tuple[I64, I64, F64, F64]:
    """Blocks at i and j that add up to a positive matrix, and the dense matrix itself."""
    every = np.arange(count)
    off = generator.normal(size=(len(pairs), 3, 3))
    own = np.tile(100.0 * np.eye(3), (count, 1, 1))
    i, j = np.concatenate([pairs[:, 0], every]), np.concatenate([pairs[:, 1], every])
    blocks, dense = np.concatenate([off, own]), np.zeros((3 * count, 3 * count))
    for a, b, block in zip(i, j, blocks, strict=True):
        dense[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += block
        if a != b:
            dense[3 * b : 3 * b + 3, 3 * a : 3 * a + 3] += block.T
    return i, j, blocks, dense


@pytest.fixture(scope="module")
def pattern() -> tuple[Pattern, I64]:
    pairs = some_pairs(np.random.default_rng(0), 25)
    return pattern_of(pairs, 25), pairs


def test_blocks_solve_and_invert_as_dense_matrices_do(pattern: tuple[Pattern, I64]) -> None:
    generator = np.random.default_rng(1)
    i, j, blocks, dense = positive_matrix(generator, pattern[1], 25)
    factor = factored(pattern[0], i, j, blocks)
    right = generator.normal(size=(25, 3))
    npt.assert_allclose(solution(factor, right).ravel(), np.linalg.solve(dense, right.ravel()))
    inverse = np.linalg.inv(dense).reshape(25, 3, 25, 3).swapaxes(1, 2)
    at, transposed = stored_at(pattern[0], i, j)
    known = inverse_blocks(factor)[at]
    known = np.where(transposed[:, None, None], known.swapaxes(1, 2), known)
    npt.assert_allclose(known, inverse[i, j], atol=1e-14)


def test_what_is_not_positive_has_no_factor(pattern: tuple[Pattern, I64]) -> None:
    i, j, blocks, _ = positive_matrix(np.random.default_rng(2), pattern[1], 25)
    blocks[-1] = 0.0
    with pytest.raises(RuntimeError, match="holds some poses by nothing"):
        factored(pattern[0], i, j, blocks)


def loop(generator: np.random.Generator) -> PoseGraph:
    """Ten poses round a loop and two closures, all measured with noise."""
    truth = chain(np.array([1.0, 2.0, 0.3]), np.tile([1.0, 0.1, 0.6], (9, 1)))
    edges = np.array([*((k, k + 1) for k in range(9)), (9, 0), (7, 2)])
    root = generator.normal(size=(len(edges), 3, 3))
    information = 400 * np.eye(3) + 20 * root @ root.swapaxes(1, 2)
    noise = np.linalg.cholesky(np.linalg.inv(information)) @ generator.normal(size=(11, 3, 1))
    measured = compose(between(truth[edges[:, 0]], truth[edges[:, 1]]), noise[:, :, 0])
    return PoseGraph(truth, edges, measured, information, np.arange(11) >= 9)


def test_residuals_and_covariances_are_gtsams() -> None:
    graph = loop(np.random.default_rng(3))
    problem, values = as_gtsam(graph, ANCHOR), as_values(graph.initial)
    ours = residuals(graph.initial, graph.edges, graph.measurements)
    for k in range(len(graph.edges)):
        npt.assert_allclose(ours[k], problem.at(k).unwhitenedError(values), atol=1e-12)
    assert half_square(graph, graph.initial) == pytest.approx(problem.error(values))
    pairs = np.array([[1, 6], [8, 3]])
    pattern = pattern_of(np.vstack([graph.edges, pairs]), 10)
    poses, equations = settle(graph, graph.initial, pattern, ANCHOR, 20)
    known, theirs = uncertainty(equations), gtsam.Marginals(problem, as_values(poses))
    for i, j in pairs:
        joint = theirs.jointMarginalCovariance([int(i), int(j)])
        for a, b in ((i, i), (i, j), (j, i)):
            covariance = covariance_of(known, np.array([a]), np.array([b]))[0]
            npt.assert_allclose(covariance, joint.at(int(a), int(b)), rtol=1e-4, atol=1e-8)


def test_covariances_are_what_chance_makes_of_the_poses() -> None:
    pairs, draws = np.array([[2, 6]]), 600
    pattern = pattern_of(np.vstack([measured_again(0).edges, pairs]), 10)
    ends, between_them = [], []
    for seed in range(draws):
        graph = measured_again(seed)
        poses, equations = settle(graph, graph.initial, pattern, ANCHOR, 5)
        ends.append(between(graph.initial[6], poses[6]))
        between_them.append(
            residuals(poses, pairs, between(graph.initial[[2]], graph.initial[[6]]))
        )
    known = uncertainty(equations)
    own = covariance_of(known, np.array([6]), np.array([6]))[0]
    relative = predicted_covariance(
        known, graph.initial, pairs, between(graph.initial[[2]], graph.initial[[6]])
    )
    for wanted, drawn in ((own, np.array(ends)), (relative[0], np.array(between_them)[:, 0])):
        scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
        npt.assert_allclose(np.cov(drawn.T) / scale, wanted / scale, atol=0.15)


def measured_again(seed: int) -> PoseGraph:
    """The loop, its poses the true ones, with noise as its information states it."""
    graph, root = loop(np.random.default_rng(0)), np.array([20.0, 30.0, 50.0])
    noise = np.random.default_rng([4, seed]).normal(size=(11, 3)) / root
    true = between(graph.initial[graph.edges[:, 0]], graph.initial[graph.edges[:, 1]])
    stated = np.tile(np.diag(root**2), (11, 1, 1))
    return PoseGraph(graph.initial, graph.edges, compose(true, noise), stated, graph.is_closure)


def test_rotations_first_needs_no_guess() -> None:
    graph = loop(np.random.default_rng(5))
    exact = between(graph.initial[graph.edges[:, 0]], graph.initial[graph.edges[:, 1]])
    lost = np.vstack([graph.initial[:1], np.random.default_rng(6).normal(size=(9, 3)) * 50])
    blind = PoseGraph(lost, graph.edges, exact, graph.information, graph.is_closure)
    found = rotation_first(blind)
    npt.assert_allclose(found[:, :2], graph.initial[:, :2], atol=1e-9)
    npt.assert_allclose(wrap_angle(found[:, 2] - graph.initial[:, 2]), 0, atol=1e-9)
