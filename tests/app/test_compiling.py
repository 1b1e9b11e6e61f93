"""Compilation is told where it happens, and only there."""

from __future__ import annotations

import numba

from elfslam.app.compiling import compilation_announced


def test_the_first_use_is_told_and_later_ones_are_not() -> None:
    twice = numba.njit(lambda value: 2 * value)
    told: list[tuple[str, float | None]] = []
    with compilation_announced(lambda *said: told.append(said)):
        assert twice(3) == 6
        first = len(told)
        assert twice(4) == 8
    assert (first, len(told)) == (1, 1)
    assert "compiling" in told[0][0]
    assert twice(0.5) == 1.0
    assert len(told) == 1, "nobody listens any more"
