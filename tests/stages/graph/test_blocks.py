"""Sparse block factorisation against dense algebra."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64, I64
from elfslam.stages.graph.blocks import (
    Pattern,
    factored,
    inverse_blocks,
    pattern_of,
    solution,
    stored_at,
)


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
