"""A city of buildings for benchmarks: what is heard on each floor, and what phones there ask."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.serve.buildings.wifi import WifiFindParameters, bssid_number, points_on
from studies.city import CityParameters, Hearing, block_of, heard_now, scans_in

WALKS, SCANS = 2, 15
"""Of the survey of each floor."""
BLOCK_M, CORNER_DEG, M_PER_DEG = 400.0, (47.0, 8.0), 111_195.0
PARAMETERS = CityParameters()
DEAF_DB, SIGMA_M = 6.0, 25.0
"""Phones hear so differently, and believe themselves so far from where they are (sigma)."""
KEPT = WifiFindParameters()


@dataclass(frozen=True)
class City:
    """Floors (f) with their middles and radii, and what is heard on them (rows p)."""

    latitude_deg: F64
    longitude_deg: F64
    radius_m: F64
    points: F64
    """Floor, bssid, level, spread and share (p, 5)."""

    @property
    def buildings(self) -> int:
        """How many there are."""
        return len(self.radius_m) // PARAMETERS.floors


@dataclass(frozen=True)
class Asker:
    """A phone: the floor that it is on, what it hears, and where it believes itself to be."""

    floor: int
    wifi: dict[str, float]
    latitude_deg: float
    longitude_deg: float


def city_of(buildings: int, seed: int, kept: Path | None) -> City:
    """The city of a seed; kept in a file for the next time, as it takes minutes."""
    if kept is not None and kept.is_file():
        with np.load(kept) as table:
            if len(table["radius_m"]) == buildings * PARAMETERS.floors:
                return City(**{name: table[name] for name in table.files})
    blocks = -(-buildings // PARAMETERS.block)
    floors = [row for number in range(blocks) for row in _surveyed(seed, number, blocks)]
    floors = floors[: buildings * PARAMETERS.floors]
    places = np.array([row[:3] for row in floors])
    rows = [np.column_stack([np.full(len(row[3]), k), row[3]]) for k, row in enumerate(floors)]
    latitude_deg, longitude_deg, radius_m = places.T
    made = City(latitude_deg, longitude_deg, radius_m, np.vstack(rows))
    if kept is not None:
        np.savez_compressed(kept, **vars(made))
    return made


def _surveyed(seed: int, number: int, blocks: int) -> Iterator[tuple[float, float, float, F64]]:
    """Latitude, longitude, radius and points of the floors of a block."""
    block = block_of(seed, number, PARAMETERS)
    for house in range(PARAMETERS.block):
        middle = block.corner_m[house] + block.side_m[house] / 2
        place = _degrees(number, blocks, middle)
        for floor in range(PARAMETERS.floors):
            generator = np.random.default_rng([seed, number, house, floor])
            walks = [
                scans_in(block, house, floor, SCANS, generator, PARAMETERS) for _ in range(WALKS)
            ]
            found = points_on(walks, KEPT)
            table = np.column_stack([found.bssid, found.level_dbm, found.spread_db, found.share])
            yield *place, float(np.linalg.norm(block.side_m[house]) / 2), table


def askers(city: City, seed: int, count: int) -> list[Asker]:
    """Phones on floors drawn at random, each with one scan."""
    generator = np.random.default_rng([seed, 1])
    blocks = -(-city.buildings // PARAMETERS.block)
    return [
        _asker(seed, int(floor), blocks, generator)
        for floor in generator.integers(0, len(city.radius_m), count)
    ]


def _asker(seed: int, which: int, blocks: int, generator: np.random.Generator) -> Asker:
    house_number, floor = divmod(which, PARAMETERS.floors)
    number, house = divmod(house_number, PARAMETERS.block)
    block = block_of(seed, number, PARAMETERS)
    hearing = Hearing(deaf_db=float(generator.normal(0, DEAF_DB)), replaced_share=0.1)
    scans = scans_in(block, house, floor, 1, generator, PARAMETERS, hearing)
    believed = block.corner_m[house] + block.side_m[house] / 2 + generator.normal(0, SIGMA_M, 2)
    return Asker(which, heard_now(scans, [0]), *_degrees(number, blocks, believed))


def _degrees(number: int, blocks: int, xy_m: F64) -> tuple[float, float]:
    row, column = divmod(number, int(np.ceil(np.sqrt(blocks))))
    north, east = row * BLOCK_M + xy_m[1], column * BLOCK_M + xy_m[0]
    steep = np.cos(np.radians(CORNER_DEG[0]))
    latitude, longitude = (
        CORNER_DEG[0] + north / M_PER_DEG,
        CORNER_DEG[1] + east / M_PER_DEG / steep,
    )
    return float(latitude), float(longitude)


def numbers_of(asker: Asker) -> list[int]:
    """The addresses that a phone hears."""
    return [bssid_number(text) for text in asker.wifi]
