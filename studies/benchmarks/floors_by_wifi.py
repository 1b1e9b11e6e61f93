"""How often Wi-Fi tells the right floor: on real walks of two mall floors, and in simulated cities.

Usage, from the root of the project:

    python -m studies.benchmarks.floors_by_wifi mall    half of the walks mapped, the others ask
    python -m studies.benchmarks.floors_by_wifi \\
        city    buildings of seed 300, phones in all circumstances

Nothing was tuned on either: parameters were chosen in the city of seed 100.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elfslam.app.console import print_rows
from elfslam.base.arrays import F64
from elfslam.base.values import WifiScans
from elfslam.data.mall import read_walk, walks_in
from elfslam.serve.buildings.find import Evidence, FindParameters, Found, KnownFloor, decide
from elfslam.serve.buildings.position import Site
from elfslam.serve.buildings.wifi import (
    RADIO_MASK,
    FloorPoints,
    KnownPoints,
    Scan,
    bssid_number,
    points_on,
    scan_of,
    wifi_log_odds,
)
from studies.city import Block, CityParameters, Hearing, block_of, heard_now, scans_in

PARAMETERS, CITY = FindParameters(), CityParameters()
FRESH_S, WEAKEST_DBM = 3.0, -92.0
SEED, BLOCKS, STRETCH_M = 300, 3, 8.0
Heard = dict[int, float]
Rows = dict[int, list[tuple[float, ...]]]
Row = dict[str, object]


def table_of(floors: Mapping[int, FloorPoints]) -> Rows:
    """By address who hears it and how."""
    rows: Rows = defaultdict(list)
    for floor, points in floors.items():
        columns = (points.bssid, points.level_dbm, points.spread_db, points.share)
        for bssid, *told in zip(*(column.tolist() for column in columns), strict=True):
            rows[bssid].append((float(floor), *told))
    return rows


def asked(rows: Rows, heard: Heard) -> tuple[Found, int | None]:
    """What would be answered: the status, and the first candidate."""
    scan = scan_of(heard, PARAMETERS.wifi)
    odds = wifi_log_odds(scan, _known(rows, scan), PARAMETERS.wifi)
    floors = [KnownFloor(k, str(k), 0, str(k), 1, Site(0, 0, 1), True) for k in odds]
    answer = decide(floors, Evidence(wifi=odds), PARAMETERS)
    first = max(odds, key=lambda floor: odds[floor], default=None)
    return answer.status, first


def _known(rows: Rows, scan: Scan) -> KnownPoints:
    found = [
        (k, *row) for k, bssid in enumerate(scan.bssid.tolist()) for row in rows.get(bssid, [])
    ]
    return KnownPoints(*np.array(found, dtype=np.float64).reshape(-1, 5).T)


def row_of(name: str, scans: int, answers: Sequence[tuple[Found, bool]]) -> Row:
    """Shares of the answers, each with whether its first candidate was right."""
    said = Counter(answers)
    share = {status: f"{said[status, True] / len(answers):.1%}" for status in Found}
    return {
        "phones": name,
        "scans": scans,
        "asked": len(answers),
        "first right": f"{sum(right for _, right in answers) / len(answers):.1%}",
        "OK right": share[Found.OK],
        "OK wrong": f"{said[Found.OK, False] / len(answers):.1%}",
        "ambiguous": f"{sum(said[Found.AMBIGUOUS, k] for k in (True, False)) / len(answers):.1%}",
        "unknown": f"{sum(said[Found.UNKNOWN_PLACE, k] for k in (True, False)) / len(answers):.1%}",
    }


def mall() -> Iterator[Row]:
    """Odd walks ask on two floors that even walks mapped."""
    folder = Path(os.environ.get("ELFSLAM_DATA", "../shared/data")) / "mall_walks"
    walks = {
        floor: [
            read_walk(path).recording.wifi for path in walks_in(folder / f"site1-{name}.tar.xz")
        ]
        for floor, name in ((1, "F1"), (4, "F4"))
    }
    known = {floor: [each for each in some if each is not None] for floor, some in walks.items()}
    points = {floor: points_on(some[::2], PARAMETERS.wifi) for floor, some in known.items()}
    asking = {floor: some[1::2] for floor, some in known.items()}
    whole = table_of(points)
    for scans in (1, 2, 4, 8):
        yield row_of("as they are", scans, list(_mall(whole, asking, scans)))
    for name, changed in (
        ("10 dB deafer", lambda heard: _deaf(heard, 10.0)),
        ("3 of 10 radios replaced", _replaced),
    ):
        for scans in (1, 4):
            yield row_of(name, scans, list(_mall(whole, asking, scans, changed)))
    for scans in (1, 4):
        only = table_of({1: points[1]})
        yield row_of("F4 not mapped", scans, list(_mall(only, {4: asking[4]}, scans)))


def _mall(
    rows: Rows,
    walks: Mapping[int, Sequence[WifiScans]],
    scans: int,
    changed: Callable[[Heard], Heard] = lambda heard: heard,
) -> Iterator[tuple[Found, bool]]:
    for floor, some in walks.items():
        for walk in some:
            numbers = [bssid_number(text) for text in walk.bssids]
            fresh = np.where(np.nan_to_num(walk.age_s) < FRESH_S, walk.rssi_dbm, np.nan)
            for first in range(0, len(walk.t_s) - scans + 1, max(scans, 3)):
                heard = _means(numbers, fresh[first : first + scans])
                if heard:
                    status, best = asked(rows, changed(heard))
                    yield status, best == floor


def _means(numbers: Sequence[int], rssi_dbm: F64) -> Heard:
    seen = np.flatnonzero(np.isfinite(rssi_dbm).any(axis=0))
    means = np.nanmean(rssi_dbm[:, seen], axis=0).tolist()
    return {numbers[k]: dbm for k, dbm in zip(seen.tolist(), means, strict=True)}


def _deaf(heard: Heard, db: float) -> Heard:
    return {number: dbm - db for number, dbm in heard.items() if dbm - db >= WEAKEST_DBM}


def _replaced(heard: Heard) -> Heard:
    """Three of ten radios have other addresses, always the same three."""
    return {
        number ^ (0x0000_00AB_CD00 if (number & RADIO_MASK) * 7919 % 1009 < 303 else 0): dbm
        for number, dbm in heard.items()
    }


def city() -> Iterator[Row]:
    """Phones on all floors of simulated blocks."""
    blocks = [block_of(SEED, number, CITY) for number in range(BLOCKS)]
    points = dict(_surveyed(blocks))
    whole = table_of(points)
    for name, hearing in (
        ("as they are", Hearing()),
        ("10 dB deafer", Hearing(deaf_db=10)),
        ("3 of 10 radios replaced", Hearing(replaced_share=0.3)),
        ("both", Hearing(10, 0.3)),
    ):
        for scans in (1, 4):
            yield row_of(name, scans, list(_city(whole, blocks, scans, hearing)))
    for name, without in (("floor not mapped", (None, 2)), ("building not mapped", (1, None))):
        left = {k: some for k, some in points.items() if not _is(k, *without)}
        for scans in (1, 4):
            yield row_of(
                name, scans, list(_city(table_of(left), blocks, scans, Hearing(), without))
            )
    others = [block_of(SEED + 1, number, CITY) for number in range(2)]
    yield row_of("another city", 1, list(_city(whole, others, 1, Hearing())))


def _surveyed(blocks: Sequence[Block]) -> Iterator[tuple[int, FloorPoints]]:
    for number, block in enumerate(blocks):
        for house, floor in np.ndindex(CITY.block, CITY.floors):
            generator = np.random.default_rng([SEED, number, house, floor])
            walks = [scans_in(block, house, floor, 20, generator, CITY) for _ in range(3)]
            yield _key(number, house, floor), points_on(walks, PARAMETERS.wifi)


def _city(
    rows: Rows,
    blocks: Sequence[Block],
    scans: int,
    hearing: Hearing,
    only: tuple[int | None, int | None] = (None, None),
) -> Iterator[tuple[Found, bool]]:
    for number, block in enumerate(blocks):
        for house, floor in np.ndindex(CITY.block, CITY.floors):
            key = _key(number, house, floor)
            if only != (None, None) and not _is(key, *only):
                continue
            generator = np.random.default_rng([SEED, number, house, floor, 7, scans])
            for _ in range(3):
                stretch = _stretch(block, house, generator)
                heard = heard_now(
                    scans_in(stretch, house, floor, scans, generator, CITY, hearing), range(scans)
                )
                status, best = asked(rows, {bssid_number(k): dbm for k, dbm in heard.items()})
                yield status, best == key


def _stretch(block: Block, house: int, generator: np.random.Generator) -> Block:
    """The same block, its house but a small square somewhere in it, where a phone is."""
    side = np.minimum(block.side_m[house], STRETCH_M)
    corners, sides = block.corner_m.copy(), block.side_m.copy()
    corners[house] += generator.uniform(0, 1, 2) * (sides[house] - side)
    sides[house] = side
    return replace(block, corner_m=corners, side_m=sides)


def _key(number: int, house: int, floor: int) -> int:
    return (number * CITY.block + house) * CITY.floors + floor


def _is(key: int, house: int | None, floor: int | None) -> bool:
    return (key // CITY.floors % CITY.block == house) or (key % CITY.floors == floor)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("mall", "city"))
    what = parser.parse_args().what
    print_rows(list({"mall": mall, "city": city}[what]()), title=f"Floors by Wi-Fi: {what}",
               as_json=False)  # fmt: skip


if __name__ == "__main__":
    main()
