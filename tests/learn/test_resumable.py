"""Batches come in order, ahead of time; the rate rises and falls."""

import pytest

from elfslam.learn.resumable import prefetched, warm_cosine


def test_batches_come_in_order_and_only_those_asked_for() -> None:
    made: list[int] = []

    def batch(step: int) -> int:
        made.append(step)
        return step * step

    assert list(prefetched(batch, 3, 9)) == [(k, k * k) for k in range(3, 9)]
    assert made == list(range(3, 9))
    assert list(prefetched(batch, 9, 9)) == []


def test_the_rate_rises_to_its_peak_and_falls_to_nothing() -> None:
    rates = [warm_cosine(step, 10, 1000) for step in range(1001)]
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == pytest.approx(1.0, abs=1e-3)
    assert rates[500] == pytest.approx(0.5)
    assert rates[1000] == pytest.approx(0.0, abs=1e-9)
