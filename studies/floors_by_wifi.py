"""How often Wi-Fi tells the right floor: real walks of two mall floors, and a simulated city.

Of the mall, every other walk maps and the others ask; the city is that of seed 300. Nothing was
tuned on either: parameters were chosen in the city of seed 100.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from elfslam.base.arrays import F64, I64, Value, array
from elfslam.base.parameters import parameter
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
    bssid_text,
    points_on,
    scan_of,
    wifi_log_odds,
)
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

MOST_ADDRESSES = 4
LOCAL_OCTETS = (0x00, 0x02, 0x06, 0x0A)
"""What the first octet of a radio's first address is changed by in its others."""
AT_1_M_DB = 40.0
NEAREST_M = 1.0
SCAN_S = 2.2


@dataclass(frozen=True)
class CityParameters:
    """How buildings are built and how radio spreads in them."""

    floors: int = parameter(4, "", "of each building", low=1, high=100)
    block: int = parameter(4, "", "buildings that hear each other", low=1, high=100)
    side_low_m: float = parameter(25.0, "m", "shortest side of a building", low=5.0)
    side_high_m: float = parameter(110.0, "m", "longest side of a building", low=5.0)
    street_m: float = parameter(18.0, "m", "between two buildings", low=0.0)
    storey_m: float = parameter(3.8, "m", "from floor to floor", low=2.0)
    m2_per_radio: float = parameter(180.0, "m2", "of floor that one access point serves", low=1.0)
    exponent_low: float = parameter(2.6, "", "path loss, open halls", low=1.5, high=6.0)
    exponent_high: float = parameter(3.4, "", "path loss, many walls", low=1.5, high=6.0)
    slab_db: float = parameter(16.0, "dB", "loss of the first slab", low=0.0)
    more_slabs_db: float = parameter(11.0, "dB", "loss of each further slab", low=0.0)
    facade_db: float = parameter(12.0, "dB", "loss of an outer wall", low=0.0)
    shadowing_db: float = parameter(6.0, "dB", "standard deviation over the floor", low=0.0)
    correlation_m: float = parameter(8.0, "m", "of shadows", low=0.5)
    fading_db: float = parameter(4.5, "dB", "standard deviation from scan to scan", low=0.0)
    threshold_dbm: float = parameter(-92.0, "dBm", "weaker beacons are not heard")
    missed_share: float = parameter(0.25, "", "of beacons, by chance", low=0.0, high=1.0)
    hotspots: float = parameter(2.0, "", "phones in a scan that share their network", low=0.0)


@dataclass(frozen=True, eq=False)
class Block(Value):
    """Buildings beside each other: their corners and sides, and the radios in all of them.

    `address` (r, 4): 0 where a radio has fewer.
    """

    corner_m: F64 = array("b", 2)
    side_m: F64 = array("b", 2)
    exponent: F64 = array("b")
    address: I64 = array("r", MOST_ADDRESSES, dtype=np.int64)
    position_m: F64 = array("r", 3)
    power_dbm: F64 = array("r")
    house: I64 = array("r", dtype=np.int64)
    seed: int = 0


@dataclass(frozen=True)
class Hearing:
    """How a phone hears: what it misses of every level, and what changed since the survey."""

    deaf_db: float = 0.0
    replaced_share: float = 0.0
    """Of the radios, by others with other addresses."""


AS_SURVEYED = Hearing()


def block_of(seed: int, number: int, parameters: CityParameters) -> Block:
    """A block of the city of a seed."""
    generator = np.random.default_rng([seed, number])
    sides = generator.uniform(parameters.side_low_m, parameters.side_high_m, (parameters.block, 2))
    corners = np.zeros_like(sides)
    corners[1:, 0] = np.cumsum(sides[:-1, 0] + parameters.street_m)
    exponent = generator.uniform(
        parameters.exponent_low, parameters.exponent_high, parameters.block
    )
    counts = np.maximum(np.round(np.prod(sides, axis=1) / parameters.m2_per_radio), 2).astype(int)
    per_house = counts * parameters.floors
    house = np.repeat(np.arange(parameters.block), per_house)
    within = generator.uniform(0.03, 0.97, (len(house), 2))
    storey = np.concatenate([np.repeat(np.arange(parameters.floors), n) for n in counts])
    height = (storey + generator.uniform(0.5, 0.9, len(house))) * parameters.storey_m
    return Block(
        corner_m=corners,
        side_m=sides,
        exponent=exponent,
        address=_addresses(generator, len(house)),
        position_m=np.column_stack([corners[house] + within * sides[house], height]),
        power_dbm=generator.normal(15, 3, len(house)),
        house=house,
        seed=int(generator.integers(2**31)),
    )


def scans_in(
    block: Block,
    house: int,
    floor: int,
    count: int,
    generator: np.random.Generator,
    parameters: CityParameters,
    hearing: Hearing = AS_SURVEYED,
) -> WifiScans:
    """Scans at random spots of a floor, all entries fresh."""
    xy_m = block.corner_m[house] + generator.uniform(0, 1, (count, 2)) * block.side_m[house]
    spots = np.column_stack([xy_m, np.full(count, floor * parameters.storey_m + 1.2)])
    levels = mean_levels_dbm(block, house, floor, spots, parameters)[:, :, None]
    levels = levels + parameters.fading_db * generator.standard_normal(
        (*levels.shape[:2], MOST_ADDRESSES)
    )
    rssi = np.round(levels - hearing.deaf_db)
    address = np.where(
        _new_radios(block, hearing.replaced_share)[:, None], block.address ^ 0x0080_0000_5550,
        block.address,
    )  # fmt: skip
    missed = generator.uniform(0, 1, rssi.shape) < parameters.missed_share
    rssi[missed | (rssi < parameters.threshold_dbm) | (address == 0)] = np.nan
    return _as_scans(rssi.reshape(count, -1), address.reshape(-1), generator, parameters)


def mean_levels_dbm(
    block: Block, house: int, floor: int, spots_m: F64, parameters: CityParameters
) -> F64:
    """Levels (n, r) without fading at spots (n, 3) of a floor."""
    away = np.linalg.norm(spots_m[:, None] - block.position_m, axis=2)
    spread = 10 * block.exponent[house] * np.log10(np.maximum(away, NEAREST_M))
    storey = np.floor(block.position_m[:, 2] / parameters.storey_m)
    slabs = np.abs(storey - floor)
    loss = np.where(
        slabs > 0, parameters.slab_db + (slabs - 1) * parameters.more_slabs_db, 0.0
    ) + np.where(block.house == house, 0.0, 2 * parameters.facade_db)
    shadows = parameters.shadowing_db * _shadows(block, floor, spots_m[:, :2], parameters)
    return np.asarray(block.power_dbm - AT_1_M_DB - spread - loss + shadows)


def _shadows(block: Block, floor: int, xy_m: F64, parameters: CityParameters) -> F64:
    """Unit fields (n, r), one a radio and floor, of sums of waves."""
    generator = np.random.default_rng([block.seed, floor])
    radios, waves = len(block.power_dbm), 12
    frequency = generator.standard_normal((2, radios, waves)) / parameters.correlation_m
    phase = generator.uniform(0, 2 * np.pi, (radios, waves))
    total = np.zeros((len(xy_m), radios))
    for k in range(waves):
        total += np.cos(xy_m @ frequency[:, :, k] + phase[:, k])
    return np.asarray(total * np.sqrt(2 / waves))


def _addresses(generator: np.random.Generator, radios: int) -> I64:
    """Up to four addresses of each radio: the first octet or the last four bits differ."""
    vendor = generator.choice(np.arange(1, 40) * 0x0031_4C, radios)
    first = (vendor.astype(np.int64) << 24) | (generator.integers(0, 2**20, radios) << 4)
    address = np.zeros((radios, MOST_ADDRESSES), dtype=np.int64)
    has = generator.integers(1, MOST_ADDRESSES + 1, radios)
    for k in range(MOST_ADDRESSES):
        address[:, k] = np.where(k < has, (first + k) ^ (LOCAL_OCTETS[k] << 40), 0)
    return address


def _new_radios(block: Block, share: float) -> np.ndarray:
    generator = np.random.default_rng([block.seed, 99])
    return np.asarray(generator.uniform(0, 1, len(block.power_dbm)) < share)


def _as_scans(
    rssi: F64, address: I64, generator: np.random.Generator, parameters: CityParameters
) -> WifiScans:
    """Scans with hotspots between; addresses never heard are left out."""
    passing = generator.poisson(parameters.hotspots, len(rssi))
    made_up = (generator.integers(0, 2**40, passing.sum()) & ~(1 << 40)) | (1 << 41)
    table = np.full((len(rssi), len(made_up)), np.nan)
    table[np.repeat(np.arange(len(rssi)), passing), np.arange(len(made_up))] = np.round(
        generator.uniform(-85, -45, len(made_up))
    )
    heard = np.isfinite(rssi).any(axis=0)
    levels = np.hstack([rssi[:, heard], table])
    names = [*address[heard].tolist(), *made_up.tolist()]
    return WifiScans(
        SCAN_S * np.arange(len(rssi), dtype=np.float64),
        tuple(bssid_text(number) for number in names),
        levels,
        np.where(np.isfinite(levels), 0.5, np.nan),
    )


def heard_now(scans: WifiScans, rows: Sequence[int]) -> dict[str, float]:
    """What some scans heard, the mean of each address."""
    some = scans.rssi_dbm[list(rows)]
    heard = np.isfinite(some).any(axis=0)
    mean = np.nanmean(some[:, heard], axis=0)
    return dict(zip([scans.bssids[k] for k in np.flatnonzero(heard)], mean.tolist(), strict=True))


# --- the study ---

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
        "OK and right (%)": said[Found.OK, True],
        "OK and wrong (%)": said[Found.OK, False],
        "ambiguous (%)": either[Found.AMBIGUOUS],
        "unknown place (%)": either[Found.UNKNOWN_PLACE],
    }
    condition = f"{scans} scan{'s' if scans > 1 else ''}"
    record = replace(of, method=method, condition=condition)
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
    whole, of = table_of(points), Record("", world=MALL)
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
    whole, of = table_of(points), Record("", world=CITY_NAME, seeds=seeds_text([SEED]))
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
