"""Sparse symmetric matrices of 3 x 3 blocks: factored, solved, and inverted where it is cheap.

The order of elimination comes from SuperLU's minimum degree, for one number per block. Of the
inverse only the blocks inside the factor's pattern are computed (Takahashi, Fagan and Chin 1973),
which are those that covariances of neighbours in a graph need.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from elfslam.base.arrays import F64, I64, Bool

Row = tuple[float, float, float]
Rows = tuple[Row, Row, Row]


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the factor has blocks: columns of a lower triangle, each with its diagonal first.

    `place` (n) says which row of the factor a node became; `key` is count * column + row of each
    block, increasing.
    """

    start: I64
    rows: I64
    place: I64
    key: I64


@dataclass(frozen=True, eq=False)
class Factor:
    """L D L' of a matrix: the blocks of L, and on its diagonal the inverses of D's."""

    pattern: Pattern
    blocks: F64


def pattern_of(pairs: I64, count: int) -> Pattern:
    """The pattern of a factor whose matrix joins the two nodes of each pair (k, 2)."""
    ends = (pairs.ravel(), pairs[:, ::-1].ravel())
    joins = csr_array((np.ones(pairs.size), ends), shape=(count, count))
    # Nothing cancels in a Laplacian: what is zero in its factor lies outside the pattern.
    laplacian = csc_array(diags_array(joins.sum(axis=1) + 1e-6) - joins)
    options = {"SymmetricMode": True}
    made = splu(laplacian, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    lower = made.L.tocsc()
    lower.sort_indices()
    start, rows = lower.indptr.astype(np.int64), lower.indices.astype(np.int64)
    key = np.repeat(np.arange(count) * count, np.diff(start)) + rows
    return Pattern(start, rows, made.perm_c.astype(np.int64), key)


def stored_at(pattern: Pattern, i: I64, j: I64) -> tuple[I64, Bool]:
    """Indices (k) of the blocks between nodes i and j, and whether (k) they lie transposed."""
    row, column = pattern.place[i], pattern.place[j]
    wanted = np.minimum(row, column) * len(pattern.place) + np.maximum(row, column)
    return np.searchsorted(pattern.key, wanted), row < column


def factored(pattern: Pattern, i: I64, j: I64, blocks: F64) -> Factor:
    """The factor of a positive matrix that is the sum of `blocks` (k, 3, 3) between i and j.

    Each pair of different nodes is given once; its mirror image is understood. Raises RuntimeError
    where the matrix is not positive: something is held by nothing.
    """
    at, transposed = stored_at(pattern, i, j)
    upright = np.where(transposed[:, None, None], np.swapaxes(blocks, 1, 2), blocks)
    matrix = summed(upright.reshape(-1, 9), at, len(pattern.rows)).reshape(-1, 3, 3)
    if not _factor_in_place(pattern.start, pattern.rows, matrix, _nobody(pattern)):
        raise RuntimeError("the graph holds some poses by nothing")
    return Factor(pattern, matrix)


def summed(rows: F64, at: I64, count: int) -> F64:
    """Sums (count, d) of the rows (e, d) of the same place `at` (e)."""
    return np.column_stack([np.bincount(at, column, count) for column in rows.T])


def solution(factor: Factor, right: F64) -> F64:
    """The x (n, 3) that the factored matrix takes to `right` (n, 3)."""
    x = np.empty_like(right)
    x[factor.pattern.place] = right
    _substitute(factor.pattern.start, factor.pattern.rows, factor.blocks, x)
    return np.asarray(x[factor.pattern.place])


def inverse_blocks(factor: Factor) -> F64:
    """The blocks of the inverse that lie inside the pattern; see `stored_at`."""
    pattern = factor.pattern
    made = _inverse_inside(pattern.start, pattern.rows, factor.blocks, _nobody(pattern))
    return np.asarray(made)


def _nobody(pattern: Pattern) -> I64:
    return np.full(len(pattern.place), -1)


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _invert(a: F64) -> bool:
    """Put the inverse of a symmetric 3 x 3 matrix in its place, if it is positive."""
    # By L D L', because products of all three sizes would cancel.
    first = a[0, 0]
    lower_y, lower_z = a[1, 0] / first, a[2, 0] / first
    second = a[1, 1] - lower_y * a[1, 0]
    inner = a[2, 1] - lower_z * a[1, 0]
    lower_zy = inner / second
    third = a[2, 2] - lower_z * a[2, 0] - lower_zy * inner
    if not (first > 0 and second > 0 and third > 0):
        return False
    corner = lower_y * lower_zy - lower_z
    a[2, 2] = 1 / third
    a[1, 2] = a[2, 1] = -lower_zy / third
    a[0, 2] = a[2, 0] = corner / third
    a[1, 1] = 1 / second + lower_zy * lower_zy / third
    a[0, 1] = a[1, 0] = -lower_y / second - corner * lower_zy / third
    a[0, 0] = 1 / first + lower_y * lower_y / second + corner * corner / third
    return True


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _rows(block: F64) -> Rows:
    """A 3 x 3 block as tuples, which stay in registers."""
    return (
        (block[0, 0], block[0, 1], block[0, 2]),
        (block[1, 0], block[1, 1], block[1, 2]),
        (block[2, 0], block[2, 1], block[2, 2]),
    )


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _dot(a: Row, b: Row) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _times(left: Rows, right: Rows) -> Rows:
    """The product of one block and the other's transpose."""
    a, b, c = left
    x, y, z = right
    return (
        (_dot(a, x), _dot(a, y), _dot(a, z)),
        (_dot(b, x), _dot(b, y), _dot(b, z)),
        (_dot(c, x), _dot(c, y), _dot(c, z)),
    )


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _subtract(block: F64, rows: Rows) -> None:
    for r in range(3):
        for c in range(3):
            block[r, c] -= rows[r][c]


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _factor_in_place(start: I64, rows: I64, matrix: F64, member: I64) -> bool:
    """Right-looking elimination, one block column after the other."""
    for column in range(len(start) - 1):
        first, last = start[column] + 1, start[column + 1]
        if not _invert(matrix[first - 1]):
            return False
        held = _rows(matrix[first - 1])
        for at in range(first, last):
            member[rows[at]] = at
        for at in range(first, last):
            lower, k = _times(_rows(matrix[at]), held), rows[at]
            for inner in range(start[k], start[k + 1]):
                other = member[rows[inner]]
                if other >= first:
                    _subtract(matrix[inner], _times(_rows(matrix[other]), lower))
            member[k] = -1
            for r in range(3):
                matrix[at, r] = lower[r]
    return True


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _substitute(start: I64, rows: I64, blocks: F64, x: F64) -> None:
    """Forward, by the diagonal, and back."""
    count = len(start) - 1
    for column in range(count):
        for at in range(start[column] + 1, start[column + 1]):
            for r in range(3):
                for c in range(3):
                    x[rows[at], r] -= blocks[at, r, c] * x[column, c]
    for column in range(count - 1, -1, -1):
        held, (a, b, c) = start[column], x[column]
        for r in range(3):
            x[column, r] = blocks[held, r, 0] * a + blocks[held, r, 1] * b + blocks[held, r, 2] * c
        for at in range(held + 1, start[column + 1]):
            for r in range(3):
                for c in range(3):
                    x[column, c] -= blocks[at, r, c] * x[rows[at], r]


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _inverse_inside(start: I64, rows: I64, blocks: F64, member: I64) -> F64:
    """Takahashi's recurrence, from the last column to the first."""
    made = np.zeros_like(blocks)
    for column in range(len(start) - 2, -1, -1):
        first, last = start[column] + 1, start[column + 1]
        made[first - 1] = blocks[first - 1]
        for at in range(first, last):
            member[rows[at]] = at
        for at in range(first, last):
            lower, k = _rows(blocks[at].T), rows[at]
            _subtract(made[at], _times(_rows(made[start[k]]), lower))
            for inner in range(start[k] + 1, start[k + 1]):
                other = member[rows[inner]]
                if other >= first:
                    _subtract(made[other], _times(_rows(made[inner]), lower))
                    _subtract(made[at], _times(_rows(made[inner].T), _rows(blocks[other].T)))
        for at in range(first, last):
            member[rows[at]] = -1
            _subtract(made[first - 1], _times(_rows(blocks[at].T), _rows(made[at].T)))
    return made
