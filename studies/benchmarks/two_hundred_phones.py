"""Phones that ask which floor they are on: latency, processor, and how far it goes.

Usage, from the root of the project:

    python -m studies.benchmarks.two_hundred_phones [--buildings 1000] [--seconds 60] [--rates 200]
    python -m studies.benchmarks.two_hundred_phones \\
        --seconds 15 --rates 100,200,300,400,600 --until 1000

PostgreSQL and the server are processes of their own, on this machine alone; both end with the
benchmark. Requests are due at random times (Poisson), whatever became of those before; latency
counts from when a request was due, and every phone comes with a connection of its own.
`--until MS` stops at the first rate whose 99th percentile is above. `--kept FILE.npz` keeps the
simulated city.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.app.console import print_rows
from elfslam.base.arrays import F32, F64
from elfslam.serve.buildings.indexes import FOLDER, LATEST
from elfslam.serve.buildings.senses import WifiFindParameters, points_on
from elfslam.serve.nearest import NearestParameters, build_index
from elfslam.serve.store.database import open_database
from elfslam.serve.store.schema import upgrade
from elfslam.serve.store.tables import Building, Floor, FloorPoint
from studies.benchmarks.own_postgresql import Postgresql, own_postgresql
from studies.benchmarks.served import Served, processor_s, start
from studies.floors_by_wifi import CityParameters, Hearing, block_of, heard_now, scans_in

WALKS, SCANS = 2, 15
"""Of the survey of each floor."""
BLOCK_M, CORNER_DEG, M_PER_DEG = 400.0, (47.0, 8.0), 111_195.0
PARAMETERS = CityParameters()
DEAF_DB, SIGMA_M = 6.0, 25.0
"""Phones hear so differently, and believe themselves so far from where they are (sigma)."""
KEPT = WifiFindParameters()
OFTEN = {"token_requests_per_s": 1e6, "address_requests_per_s": 1e6}
"""Limits of a server that refuses no haste."""
DRAIN_S = 20.0
QUESTIONS = 2000
SAID = ("OK", "OK wrong", "AMBIGUOUS", "UNKNOWN_PLACE")
ALONE = ("wifi", "position", "both", "echoes")
SENSES = ("wifi", "position", "mixed")
"""Mixed: a quarter each of the phones asks in each of the other ways; echoes come with a position.
"""
SPOTS, STEPS, SIZE, ENCODER = 100, 4, 128, "simulated"
"""Of each floor and of each question: vectors with much in common, as many as there are ELFs."""
Row = dict[str, object]


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


@dataclass(frozen=True)
class Asked:
    """A request as bytes, and the floor that is right."""

    content: bytes
    floor: str


@dataclass(frozen=True)
class Answered:
    """How long it took from when it was due, whether it was answered, and what with."""

    taken_s: float
    outcome: str


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


def fill(database: Postgresql, city: City) -> None:
    """The tables as publishing fills them, without packages."""
    import psycopg

    engine = open_database(database.url)
    upgrade(engine, Path(database.folder))
    engine.dispose()
    floors = PARAMETERS.floors
    with psycopg.connect(database.told) as connection, connection.cursor() as cursor:
        with cursor.copy(f"COPY {Building.__tablename__} (number, name) FROM STDIN") as copy:
            for number in range(city.buildings):
                copy.write_row((number, f"building {number}"))
        columns = "number, id, building, level, latitude_deg, longitude_deg, radius_m, has_wifi, "
        columns += "revision, manifest, published_utc"
        with cursor.copy(f"COPY {Floor.__tablename__} ({columns}) FROM STDIN") as copy:
            for k, place in enumerate(zip(city.latitude_deg, city.longitude_deg, city.radius_m,
                                          strict=True)):  # fmt: skip
                told = map(float, place)
                copy.write_row(
                    (k, _map_id(k), k // floors, k % floors, *told, True, 1, "{}", "now")
                )
        columns = "floor, bssid, level_dbm, spread_db, share"
        with cursor.copy(f"COPY {FloorPoint.__tablename__} ({columns}) FROM STDIN") as copy:
            for row in city.points:
                copy.write_row((int(row[0]), int(row[1]), *map(float, row[2:])))
        connection.commit()
        connection.autocommit = True
        cursor.execute("ANALYZE")


def sizes(database: Postgresql) -> Row:
    """Bytes of the tables with their indices."""
    import psycopg

    with psycopg.connect(database.told) as connection:
        told = [
            (table.__tablename__, *row)
            for table in (Building, Floor, FloorPoint)
            for row in connection.execute(
                f"SELECT count(*), pg_total_relation_size('{table.__tablename__}') "
                f"FROM {table.__tablename__}"
            )
        ]
    return {f"{name} ({count})": f"{size / 2**20:.1f} MiB" for name, count, size in told}


def sounds(floor: int) -> F32:
    """Unit rows (spots, 128) of a floor."""
    generator = np.random.default_rng([7, floor])
    own = 0.05 * generator.standard_normal((SPOTS, SIZE), dtype=np.float32)
    rows = np.eye(1, SIZE, dtype=np.float32) + own
    unit: F32 = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return unit


def place_index(data: Path, city: City) -> None:
    """An index of all floors' spots where the server looks for it."""
    folder, count = data / FOLDER, len(city.radius_m)
    folder.mkdir(parents=True)
    kind = NearestParameters(kind="flat" if count * SPOTS < 20_000 else "ivf-flat")
    maps = {_map_id(k): SPOTS for k in range(count)}
    rows = np.vstack([sounds(k).astype(np.float16) for k in range(count)])
    build_index([rows], folder / "1", kind, encoder=ENCODER, maps=maps)
    (folder / LATEST).write_text("1")


@contextmanager
def serving(database: Postgresql, city: City, *, echoes: bool) -> Iterator[Served]:
    """The server, as `elfslam serve` runs it, but that it refuses no haste."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        if echoes:
            place_index(data, city)
        # quiet: of every phone that is refused it says a line
        served = start(data, quiet=True, database=database.url, limits=OFTEN)
        try:
            yield served
        finally:
            served.kill()


def requests_of(phones: Sequence[Asker], senses: str, token: str) -> list[Asked]:
    """What phones send, ready to be written to a socket."""
    ways = ALONE if senses == "mixed" else (senses,)
    return [
        Asked(_request(_question(phone, ways[k % len(ways)]), token), _map_id(phone.floor))
        for k, phone in enumerate(phones)
    ]


def _question(phone: Asker, senses: str) -> dict[str, Any]:
    told: dict[str, Any] = {}
    if senses in ("wifi", "both"):
        told["wifi"] = phone.wifi
    if senses == "echoes":
        vectors = sounds(phone.floor)[:STEPS].round(5).tolist()
        told["echoes"] = {"encoder": ENCODER, "vectors": vectors}
    if senses != "wifi":
        place = {"latitude_deg": phone.latitude_deg, "longitude_deg": phone.longitude_deg}
        told["position"] = {**place, "sigma_m": SIGMA_M}
    return told


def _request(question: dict[str, Any], token: str) -> bytes:
    body = json.dumps(question).encode()
    head = (
        f"POST /api/find HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        "Connection: close\r\n\r\n"
    )
    return head.encode() + body


async def load(
    served: Served, asked: Sequence[Asked], rate: float, seconds: float
) -> list[Answered]:
    """Ask at random times, so many a second; all that was asked is waited for, not for long."""
    port = int(served.url.rstrip("/").rpartition(":")[2])
    generator = np.random.default_rng(5)
    gaps = generator.exponential(1 / rate, round(rate * seconds))
    due_s = time.perf_counter() + 0.2 + np.cumsum(gaps)
    chosen = generator.integers(0, len(asked), len(due_s))
    waiting = []
    for at_s, k in zip(due_s.tolist(), chosen.tolist(), strict=True):
        await asyncio.sleep(max(0.0, at_s - time.perf_counter()))
        waiting.append(asyncio.create_task(_ask(port, asked[k], at_s)))
    return list(await asyncio.gather(*waiting))


async def _ask(port: int, asked: Asked, due_s: float) -> Answered:
    try:
        async with asyncio.timeout(DRAIN_S):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(asked.content)
            answer = await reader.read()
            writer.close()
    except (OSError, TimeoutError) as error:
        return Answered(time.perf_counter() - due_s, type(error).__name__)
    taken_s = time.perf_counter() - due_s
    status = answer.split(b" ", 2)[1].decode() if answer else "cut off"
    if status != "200":
        return Answered(taken_s, status)
    told = json.loads(answer.partition(b"\r\n\r\n")[2])
    first = told["candidates"][0]["map"] if told["candidates"] else None
    return Answered(taken_s, told["status"] + (" right" if first == asked.floor else " wrong"))


def database_s(process: int) -> float:
    """Processor time of a database so far, and of the processes that it started."""
    found = (int(each.name) for each in Path("/proc").glob("[0-9]*"))
    return sum(map(processor_s, [process, *(each for each in found if _parent(each) == process)]))


def _parent(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return 0


def measured(
    served: Served, database: Postgresql, asked: Sequence[Asked], rate: float, seconds: float
) -> Row:
    """One row of the table."""
    before = processor_s(served.process.pid), database_s(database.process.pid)
    begin_s = time.perf_counter()
    answers = asyncio.run(load(served, asked, rate, seconds))
    wall_s = time.perf_counter() - begin_s
    server_s = processor_s(served.process.pid) - before[0]
    kept_s = database_s(database.process.pid) - before[1]
    taken_ms = 1000 * np.array([each.taken_s for each in answers])
    outcomes = Counter(each.outcome for each in answers)
    said: Counter[str] = Counter()
    for name in [name for name in outcomes if name.endswith((" right", " wrong"))]:
        said[name if name == "OK wrong" else name.partition(" ")[0]] += outcomes.pop(name)
    share = {name: f"{said[name] / len(answers):.1%}" for name in SAID}
    answered = max(len(answers) - sum(outcomes.values()), 1)
    return {
        "a second": rate,
        "asked": len(answers),
        "median ms": float(np.median(taken_ms)),
        "99 % ms": float(np.quantile(taken_ms, 0.99)),
        "worst ms": float(taken_ms.max()),
        "errors": sum(outcomes.values()),
        "server ms each": 1000 * server_s / answered,
        "database ms each": 1000 * kept_s / answered,
        "server core": f"{server_s / wall_s:.0%}",
        "database core": f"{kept_s / wall_s:.0%}",
        **share,
    }


def _map_id(floor: int) -> str:
    return f"{floor:032x}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--buildings", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rates", default="200")
    parser.add_argument("--senses", default=",".join(SENSES))
    parser.add_argument("--until", type=float, default=float("inf"))
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    city = city_of(known.buildings, 200, known.kept)
    phones = askers(city, 200, QUESTIONS)
    with own_postgresql() as database:
        fill(database, city)
        print_rows([sizes(database)], title="In the database", as_json=known.json)
        table = []
        ways = known.senses.split(",")
        with serving(database, city, echoes=bool({"echoes", "mixed"} & {*ways})) as served:
            for senses in ways:
                asked = requests_of(phones, senses, served.token)
                measured(served, database, asked, 20, 2)  # the first answers take longer
                for rate in map(float, known.rates.split(",")):
                    row = measured(served, database, asked, rate, known.seconds)
                    table.append({"by": senses, **row})
                    if float(str(row["99 % ms"])) > known.until:
                        break
    print_rows(table, title="Phones that ask where they are", as_json=known.json)


if __name__ == "__main__":
    main()
