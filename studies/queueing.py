"""How long requests wait for servers: simulated one by one, and by the textbook's formula."""

from __future__ import annotations

import heapq
import math

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError


def waits_s(arrival_s: F64, service_s: F64, servers: int) -> F64:
    """How long each request (n) waits, first come first served, by the first of `servers` free.

    `arrival_s` grows. Raises InputError without a server.
    """
    if servers < 1:
        raise InputError(f"queue: wanted at least one server, got {servers}; give it one")
    free_s = [0.0] * servers
    waits = np.empty(len(arrival_s))
    for k, (arrives_s, takes_s) in enumerate(
        zip(arrival_s.tolist(), service_s.tolist(), strict=True)
    ):
        begins_s = max(arrives_s, free_s[0])
        heapq.heapreplace(free_s, begins_s + takes_s)
        waits[k] = begins_s - arrives_s
    return waits


def expected_wait_s(rate_hz: float, mean_s: float, variation: float, servers: int) -> float:
    """The mean wait in the long run; infinite where more comes than can be served.

    `variation` is the standard deviation of the service over its mean. Exact for one server
    (Pollaczek and Khinchine) and for exponential service (Erlang's C); else the product of the two
    (Allen and Cunneen's approximation).
    """
    offered = rate_hz * mean_s
    if offered >= servers:
        return math.inf
    exponential_s = waiting_share(offered, servers) * mean_s / (servers - offered)
    return exponential_s * (1 + variation**2) / 2


def waiting_share(offered: float, servers: int) -> float:
    """Erlang's C: the share that has to wait where `offered` servers' worth of work comes."""
    blocked = 1.0
    for count in range(1, servers + 1):
        blocked = offered * blocked / (count + offered * blocked)
    busy = offered / servers
    return blocked / (1 - busy * (1 - blocked))


def drawn_services_s(
    count: int, mean_s: float, variation: float, generator: np.random.Generator
) -> F64:
    """Times of service (n), lognormal; all the same where there is no variation."""
    spread = math.sqrt(math.log1p(variation**2))
    return np.asarray(generator.lognormal(math.log(mean_s) - spread**2 / 2, spread, count))


def arrivals_s(hourly: F64, from_s: float, until_s: float, generator: np.random.Generator) -> F64:
    """When requests come, at random, where `hourly` (24) says how many are expected each hour."""
    starts_s = 3600.0 * np.arange(len(hourly))
    begin_s = np.clip(starts_s, from_s, until_s)
    end_s = np.clip(starts_s + 3600.0, from_s, until_s)
    counts = generator.poisson(hourly * (end_s - begin_s) / 3600.0)
    return np.sort(generator.uniform(np.repeat(begin_s, counts), np.repeat(end_s, counts)))
