"""Blocks of buildings and what Wi-Fi is heard on their floors, many enough for a city.

Log-distance path loss (exponents of ITU-R P.1238 for offices and shops) with a loss per slab and
per outer wall, shadows that stay with the place, fading from scan to scan. A radio has up to four
addresses; neighbours across the street are heard as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Value, array
from elfslam.base.parameters import parameter
from elfslam.base.values import WifiScans
from elfslam.serve.buildings.senses import bssid_text

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
        _replaced(block, hearing.replaced_share)[:, None], block.address ^ 0x0080_0000_5550,
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


def _replaced(block: Block, share: float) -> np.ndarray:
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
