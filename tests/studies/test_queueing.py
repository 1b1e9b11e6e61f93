"""Waits of a queue: planted ones, the laws of the textbook, refusals."""

import math

import numpy as np
import pytest

from elfslam.base.errors import InputError
from studies.queueing import arrivals_s, drawn_services_s, expected_wait_s, waiting_share, waits_s


def test_who_finds_the_server_free_does_not_wait_and_others_wait_for_the_rest():
    arrival, service = np.array([0.0, 1.0, 2.0, 10.0]), np.full(4, 3.0)
    assert waits_s(arrival, service, 1).tolist() == [0.0, 2.0, 4.0, 0.0]


def test_a_second_server_takes_the_next_one():
    arrival, service = np.array([0.0, 1.0, 2.0, 2.5]), np.array([3.0, 5.0, 1.0, 1.0])
    assert waits_s(arrival, service, 2).tolist() == [0.0, 0.0, 1.0, 1.5]


@pytest.mark.parametrize(("servers", "variation"), [(1, 0.0), (1, 1.5), (2, 1.0), (4, 1.0)])
def test_the_formula_is_what_a_long_queue_waits(servers, variation):
    generator = np.random.default_rng(5)
    arrival = np.cumsum(generator.exponential(1.0, 400_000))
    service = drawn_services_s(len(arrival), 0.7 * servers, variation, generator)
    wanted = expected_wait_s(1.0, 0.7 * servers, variation, servers)
    assert waits_s(arrival, service, servers).mean() == pytest.approx(wanted, rel=0.1)


def test_the_formula_knows_the_planted_answers():
    assert waiting_share(0.5, 1) == pytest.approx(0.5)
    assert waiting_share(1.0, 2) == pytest.approx(1 / 3)
    assert expected_wait_s(0.5, 1.0, 1.0, 1) == pytest.approx(1.0)
    assert expected_wait_s(0.5, 1.0, 0.0, 1) == pytest.approx(0.5)
    assert expected_wait_s(2.0, 1.0, 1.0, 2) == math.inf


def test_services_have_the_mean_and_the_variation_that_were_asked_for():
    drawn = drawn_services_s(200_000, 2.0, 0.7, np.random.default_rng(0))
    assert drawn.mean() == pytest.approx(2.0, rel=0.01)
    assert drawn.std() / drawn.mean() == pytest.approx(0.7, rel=0.03)


def test_requests_come_when_they_are_expected():
    hourly = np.array([0.0, 1000.0, 3000.0, 0.0])
    come = arrivals_s(hourly, 0.0, 4 * 3600.0, np.random.default_rng(1))
    counts = np.histogram(come, 3600.0 * np.arange(5))[0]
    assert np.all(np.diff(come) >= 0)
    assert counts[[0, 3]].tolist() == [0, 0]
    assert counts[1:3] == pytest.approx([1000, 3000], rel=0.15)
    part = arrivals_s(hourly, 1.5 * 3600, 2.0 * 3600, np.random.default_rng(1))
    assert len(part) == pytest.approx(500, rel=0.2)
    assert part.min() >= 1.5 * 3600


def test_a_queue_without_a_server_is_refused():
    with pytest.raises(InputError, match="wanted at least one server, got 0"):
        waits_s(np.zeros(1), np.ones(1), 0)
