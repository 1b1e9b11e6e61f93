"""What many buildings and their phones cost: on paper, and by a simulation of a day's load.

The costs of one request, one walk and one building are measured elsewhere;
docs/explanation/cost.md names the command of each. What people do is assumed, and stands here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import ParameterError
from studies.figures.fleet_figures import fleet_page
from studies.finding import Finding, Given, Row
from studies.queueing import arrivals_s, drawn_services_s, expected_wait_s, waits_s

LINK_BYTES_PER_S = 1e9 / 8
"""Of a server on a link of 1 Gbit/s."""
MOST_REQUESTS = 500_000
"""Simulated at a time; of more, those that come last before the busiest hour ends."""
TIMES = (1, 2, 5, 10, 20, 50, 100, 200, 500)
"""What the load is multiplied by, to see what breaks first."""
LATE_SHARE = 0.99
SHORT_S = 1e-5
STEADY = 50_000
"""Requests from which a steady mean is taken."""
GB = 1e9
SHOPPING = (0, 0, 0, 0, 0, 0, 0, 1, 3, 5, 7, 9, 11, 10, 8, 8, 9, 11, 9, 6, 3, 1, 0, 0)
"""Visits by the hour of the day, assumed: shops and offices, busiest at noon and at five."""


@dataclass(frozen=True)
class Demand:
    """What people do in a day, assumed. Raises ParameterError where nobody comes."""

    buildings: int = 1000
    phones: int = 100_000
    first_share: float = 0.3
    """Of the phones that have no map of the building yet."""
    walks_per_building: float = 3.0
    walk_minutes: float = 5.0

    def __post_init__(self) -> None:
        for name in ("buildings", "phones", "walks_per_building", "walk_minutes"):
            if getattr(self, name) <= 0:
                raise ParameterError(
                    f"demand.{name}: wanted more than 0, got {getattr(self, name)}; set it"
                )

    @property
    def walks(self) -> float:
        """Of all buildings."""
        return self.buildings * self.walks_per_building


@dataclass(frozen=True)
class Costs:
    """What one of each costs, measured on two cores: see docs/explanation/cost.md."""

    lookup_s: float = 0.004
    """Of a core, server and database together."""
    page_bytes: float = 3.8e6
    """The page and its runtime, once for each phone."""
    package_bytes: float = 3.4e6
    """A building's map and encoder."""
    update_bytes: float = 0.3e6
    upload_bytes_per_minute: float = 1.65e6
    mapping_s: float = 5.0
    """Of a core for each walk, however short: a new interpreter, a report."""
    mapping_s_per_minute: float = 1.0
    merging_s: float = 5.0
    run_bytes: float = 5.9e6
    """Of each walk, however short."""
    run_bytes_per_minute: float = 3.6e6
    map_bytes: float = 9.8e6
    database_bytes: float = 49e3
    """Of a building of four floors."""


@dataclass(frozen=True)
class Station:
    """Where requests wait: so many a day, served by so many servers, and how late is too late."""

    name: str
    servers: int
    a_day: float
    mean_s: float
    variation: float
    limit_s: float


def stations_of(demand: Demand, costs: Costs) -> tuple[Station, ...]:
    """Everything that a day's load waits for: one machine of two cores on one link."""
    fetched, spread = _mixture(
        demand.first_share, costs.page_bytes + costs.package_bytes, costs.update_bytes
    )
    sent = costs.upload_bytes_per_minute * demand.walk_minutes
    walk_s = costs.mapping_s + costs.mapping_s_per_minute * demand.walk_minutes + costs.merging_s
    return (
        Station("finding the map", 2, demand.phones, costs.lookup_s, 1.0, 1.0),
        Station("fetching it", 1, demand.phones, fetched / LINK_BYTES_PER_S, spread, 10.0),
        Station("uploading walks", 1, demand.walks, sent / LINK_BYTES_PER_S, 0.7, 10.0),
        Station("mapping, merging", 2, demand.walks, walk_s, 0.7, 600.0),
    )


def stores_of(demand: Demand, costs: Costs) -> dict[str, tuple[float, float]]:
    """Bytes that stay for ever, and bytes that come each day, by what they are."""
    minutes = demand.walks * demand.walk_minutes
    return {
        "maps, packages": (demand.buildings * (costs.map_bytes + costs.package_bytes), 0.0),
        "the database": (demand.buildings * costs.database_bytes, 0.0),
        "recordings": (0.0, minutes * costs.upload_bytes_per_minute),
        "runs": (0.0, demand.walks * costs.run_bytes + minutes * costs.run_bytes_per_minute),
    }


def measure_fleet(
    given: Given,
    *,
    demand: Demand | None = None,
    costs: Costs | None = None,
    times: Sequence[int] = TIMES,
    disk_bytes: float = 10e12,
    seed: int = 0,
) -> Finding:
    """A row for everything that may break, on paper and simulated."""
    wanted, known = demand or Demand(), costs or Costs()
    rows, curves = [], {}
    for station in stations_of(wanted, known):
        given.announce(station.name, None)
        waits = {many: _day(station, many, seed) for many in times}
        rows.append(_row(station, waits))
        curves[station.name] = {many: _late_s(each) for many, each in waits.items()}
    for name, (stays, comes) in stores_of(wanted, known).items():
        rows.append(_store_row(name, stays, comes, disk_bytes))
    limits = {station.name: station.limit_s for station in stations_of(wanted, known)}
    return Finding(rows, fleet_page(rows, curves, limits))


def hourly(a_day: float) -> F64:
    """Requests expected in each hour (24) of a day."""
    shares = np.array(SHOPPING, float)
    return np.asarray(a_day * shares / shares.sum())


def _day(station: Station, times: int, seed: int) -> F64:
    """Waits (n) of a day's requests, `times` as many, up to the end of the busiest hour or all."""
    expected = hourly(station.a_day * times)
    until_s, from_s = 86_400.0, 0.0
    if expected.sum() > MOST_REQUESTS:
        until_s = 3600.0 * (int(np.argmax(expected)) + 1)
        from_s = until_s - 3600.0 * min(1.0, MOST_REQUESTS / expected.max())
    generator = np.random.default_rng([seed, times])
    arrival_s = arrivals_s(expected, from_s, until_s, generator)
    service_s = drawn_services_s(len(arrival_s), station.mean_s, station.variation, generator)
    return waits_s(arrival_s, service_s, station.servers)


def _row(station: Station, waits: Mapping[int, F64]) -> Row:
    rate_hz = float(hourly(station.a_day).max()) / 3600.0
    busy = rate_hz * station.mean_s / station.servers
    wait_s = expected_wait_s(rate_hz, station.mean_s, station.variation, station.servers)
    late = [many for many, each in waits.items() if _late_s(each) > station.limit_s]
    return {
        "what": station.name,
        "a day": f"{station.a_day:,.0f}",
        "work a day": f"{station.a_day * station.mean_s / 3600:.2f} h",
        "busy": f"{busy:.1%}",
        "wait": _shown_s(wait_s),
        "simulated": _shown_s(_busiest_s(station, rate_hz)),
        "99 %": _shown_s(_late_s(waits[min(waits)])),
        "breaks at": f"{min(late)} times" if late else f"beyond {max(waits)} times",
        "full": f"{1 / busy:.1f} times",
    }


def _store_row(name: str, stays: float, comes: float, disk_bytes: float) -> Row:
    days = disk_bytes / comes if comes else math.inf
    full = f"{days:,.0f} days" if comes else ""
    return {
        "what": name,
        "a day": f"{comes / GB:.1f} GB" if comes else f"{stays / GB:.2f} GB in all",
        **dict.fromkeys(("work a day", "busy", "wait", "simulated", "99 %"), ""),
        "breaks at": "",
        "full": full,
    }


def _busiest_s(station: Station, rate_hz: float) -> float:
    """The mean simulated wait where it is always as busy as in the busiest hour."""
    generator = np.random.default_rng(1)
    arrival_s = np.cumsum(generator.exponential(1 / rate_hz, STEADY))
    service_s = drawn_services_s(STEADY, station.mean_s, station.variation, generator)
    return float(waits_s(arrival_s, service_s, station.servers).mean())


def _late_s(waits: F64) -> float:
    return float(np.quantile(waits, LATE_SHARE))


def _mixture(share: float, one: float, other: float) -> tuple[float, float]:
    """The mean of what is `one` with this share and else the `other`, and its variation."""
    mean = share * one + (1 - share) * other
    return mean, abs(one - other) * math.sqrt(share * (1 - share)) / mean


def _shown_s(seconds: float) -> str:
    if seconds < SHORT_S:
        return "none"
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
