"""How often Wi-Fi tells the right floor: real walks of two mall floors, and a simulated city.

Of the mall, every other walk maps and the others ask; the city is that of seed 300. Nothing was
tuned on either: parameters were chosen in the city of seed 100.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import WifiScans
from elfslam.data.mall import read_walk, walks_in
from elfslam.serve.buildings.find import Evidence, FindParameters, Found, KnownFloor, decide
from elfslam.serve.buildings.senses import (
    RADIO_MASK,
    FloorPoints,
    KnownPoints,
    Scan,
    Site,
    bssid_number,
    points_on,
    scan_of,
    wifi_log_odds,
)
from studies.city import Block, CityParameters, Hearing, block_of, heard_now, scans_in
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

PARAMETERS, CITY = FindParameters(), CityParameters()
FRESH_S, WEAKEST_DBM = 3.0, -92.0
SEED, BLOCKS, STRETCH_M = 300, 3, 8.0
MALL, CITY_NAME = "mall floors", "simulated city"
FILES = {1: "mall_walks/site1-F1.tar.xz", 4: "mall_walks/site1-F4.tar.xz"}
AS_THEY_ARE, DEAF, REPLACED = "phones as they are", "10 dB deafer", "3 of 10 radios replaced"
UNMAPPED = "on an unmapped floor"
Heard = dict[int, float]
Rows = dict[int, list[tuple[float, ...]]]


def measure_floors_by_wifi(
    context: StudyContext, *, blocks: int = BLOCKS, most_walks: int | None = None
) -> Iterator[Record]:
    """Shares of answers by what the phones are like (the method) and by scans (the condition)."""
    yield from in_mall(context, most_walks)
    yield from in_city(blocks)


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


def records_of(
    method: str, scans: int, answers: Sequence[tuple[Found, bool]], of: Record
) -> Iterator[Record]:
    """Shares of the answers, each with whether its first candidate was right."""
    said = Counter(answers)
    either = {status: said[status, True] + said[status, False] for status in Found}
    counts = {
        "right floor first (%)": sum(right for _, right in answers),
        "OK and right (%)": said[Found.OK, True],
        "OK and wrong (%)": said[Found.OK, False],
        "ambiguous (%)": either[Found.AMBIGUOUS],
        "unknown place (%)": either[Found.UNKNOWN_PLACE],
    }
    condition = f"{scans} scan{'s' if scans > 1 else ''}"
    record = replace(of, method=method, condition=condition)
    yield replace(record, metric="questions", value=float(len(answers)))
    for metric, count in counts.items():
        yield replace(record, metric=metric, value=100 * count / len(answers))


def in_mall(context: StudyContext, most_walks: int | None) -> Iterator[Record]:
    """Odd walks ask on two floors that even walks mapped."""
    assert context.data is not None
    walks = {
        floor: [
            read_walk(path).recording.wifi
            for path in islice(walks_in(context.data / name), most_walks)
        ]
        for floor, name in FILES.items()
    }
    known = {floor: [each for each in some if each is not None] for floor, some in walks.items()}
    points = {floor: points_on(some[::2], PARAMETERS.wifi) for floor, some in known.items()}
    asking = {floor: some[1::2] for floor, some in known.items()}
    whole, of = table_of(points), Record("", "", 0.0, world=MALL)
    changes: dict[str, Callable[[Heard], Heard]] = {
        AS_THEY_ARE: lambda heard: heard, DEAF: lambda heard: _deaf(heard, 10.0),
        REPLACED: _replaced,
    }  # fmt: skip
    for method, changed in changes.items():
        for scans in (1, 2, 4, 8) if method == AS_THEY_ARE else (1, 4):
            yield from records_of(method, scans, list(_mall(whole, asking, scans, changed)), of)
    only = table_of({1: points[1]})
    for scans in (1, 4):
        yield from records_of(UNMAPPED, scans, list(_mall(only, {4: asking[4]}, scans)), of)


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


def in_city(count: int) -> Iterator[Record]:
    """Phones on all floors of simulated blocks."""
    blocks = [block_of(SEED, number, CITY) for number in range(count)]
    points = dict(_surveyed(blocks))
    whole, of = table_of(points), Record("", "", 0.0, world=CITY_NAME, seeds=seeds_text([SEED]))
    for method, hearing in (
        (AS_THEY_ARE, Hearing()),
        (DEAF, Hearing(deaf_db=10)),
        (REPLACED, Hearing(replaced_share=0.3)),
        ("both", Hearing(10, 0.3)),
    ):
        for scans in (1, 4):
            answers = list(_city(whole, blocks, scans, hearing))
            yield from records_of(method, scans, answers, of)
    for method, without in ((UNMAPPED, (None, 2)), ("in an unmapped building", (1, None))):
        left = table_of({k: some for k, some in points.items() if not _is(k, *without)})
        for scans in (1, 4):
            answers = list(_city(left, blocks, scans, Hearing(), without))
            yield from records_of(method, scans, answers, of)
    others = [block_of(SEED + 1, number, CITY) for number in range(2)]
    yield from records_of("another city", 1, list(_city(whole, others, 1, Hearing())), of)


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


STUDY = Study(
    "How often does Wi-Fi tell a phone the right floor, among those that are mapped and not?",
    measure_floors_by_wifi, minutes=5, data=tuple(FILES.values()),
    fast={"blocks": 1, "most_walks": 6},
)  # fmt: skip
