"""Which floor a phone is on: the log-odds of each modality, added up.

Every modality gives log-odds for a floor, against being anywhere else; one that cannot know of a
floor says nothing of it. Their sum, each bounded, gives the share of each floor and of "elsewhere"
(odds 1). The best floor is the answer only where its share is large and no modality knows another
building instead; nothing is ever guessed. What a phone tells is looked up in the database by two
queries, whatever it tells.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import Annotated, Any, TypeVar

import numpy as np
import sqlalchemy as sa
from anyio import to_thread
from fastapi import APIRouter, Response
from pydantic import BaseModel, Field, model_validator
from sqlalchemy.engine import Connection
from sqlalchemy.orm import InstrumentedAttribute

from elfslam.base.arrays import F32
from elfslam.base.parameters import parameter
from elfslam.base.values import ELF_SIZE
from elfslam.serve.buildings import senses
from elfslam.serve.buildings.files import index_of
from elfslam.serve.people.access import Token, admit
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.store.database import POSTGRESQL, looking
from elfslam.serve.store.tables import Building, Floor, FloorPoint


class Found(StrEnum):
    """What came of it."""

    OK = "OK"
    AMBIGUOUS = "AMBIGUOUS"
    UNKNOWN_PLACE = "UNKNOWN_PLACE"


@dataclass(frozen=True)
class RuleParameters:
    """When an answer is one."""

    sure_share: float = parameter(0.95, "", "of the best floor, to be the answer", low=0.5)
    elsewhere_share: float = parameter(
        0.5, "", "from here on the place is unknown", low=0.05, high=1.0
    )
    denying_log_odds: float = parameter(
        5.0, "", "with so much a modality knows another building, or that it is not this", low=0.0
    )
    most_log_odds: float = parameter(30.0, "", "of one modality, either way", low=1.0)
    most_candidates: int = parameter(10, "", "are told", low=1, high=1000)
    least_share: float = parameter(0.001, "", "of a candidate that is told", low=0.0, high=0.5)


@dataclass(frozen=True)
class FindParameters:
    """All parameters of finding a floor."""

    wifi: senses.WifiFindParameters = field(default_factory=senses.WifiFindParameters)
    position: senses.PositionFindParameters = field(default_factory=senses.PositionFindParameters)
    echo: senses.EchoFindParameters = field(default_factory=senses.EchoFindParameters)
    rule: RuleParameters = field(default_factory=RuleParameters)


@dataclass(frozen=True, eq=False)
class Asked:
    """What a phone tells: levels (dBm) by address, where it believes to be, features it hears."""

    wifi: Mapping[int, float] = field(default_factory=dict)
    place: senses.Place | None = None
    vectors: F32 | None = None
    encoder: str = ""


@dataclass(frozen=True)
class KnownFloor:
    """A floor that may be the one."""

    number: int
    building: str
    level: int
    map_id: str
    revision: int
    site: senses.Site
    has_wifi: bool


@dataclass(frozen=True, eq=False)
class Evidence:
    """What each modality says of floors by their number; None where it was not asked.

    `wifi_silent` is what it says of a floor with Wi-Fi that knows nothing of what was heard.
    """

    wifi: Mapping[int, float] | None = None
    wifi_silent: float = 0.0
    place: senses.Place | None = None
    echo: senses.EchoEvidence | None = None


@dataclass(frozen=True)
class Candidate:
    """A floor and its share of the belief."""

    floor: KnownFloor
    share: float


@dataclass(frozen=True)
class Answer:
    """What is said: candidates best first, and whether the first is the answer."""

    status: Found
    candidates: tuple[Candidate, ...]


def decide(floors: Iterable[KnownFloor], evidence: Evidence, parameters: FindParameters) -> Answer:
    """The answer from what the modalities say of some floors."""
    known, rule = list(floors), parameters.rule
    said = {floor.number: log_odds_of(floor, evidence, parameters) for floor in known}
    odds = np.array([0.0, *(sum(each or 0.0 for each in said[floor.number]) for floor in known)])
    share = np.exp(odds - odds.max())
    share /= share.sum()
    order = sorted(range(len(known)), key=lambda k: (-share[k + 1], known[k].number))
    told = tuple(
        Candidate(known[k], float(share[k + 1]))
        for k in order[: rule.most_candidates]
        if share[k + 1] >= rule.least_share
    )
    if not told or share[0] >= rule.elsewhere_share:
        return Answer(Found.UNKNOWN_PLACE, told)
    sure = told[0].share >= rule.sure_share and not _denied(told[0].floor, known, said, rule)
    return Answer(Found.OK if sure else Found.AMBIGUOUS, told)


def log_odds_of(
    floor: KnownFloor, evidence: Evidence, parameters: FindParameters
) -> tuple[float | None, ...]:
    """What Wi-Fi, position and echoes say for a floor; None where one says nothing of it."""
    wifi = place = echo = None
    if evidence.wifi is not None and floor.has_wifi:
        wifi = evidence.wifi.get(floor.number, evidence.wifi_silent)
    if evidence.place is not None:
        place = senses.position_log_odds(evidence.place, floor.site, parameters.position)
    if evidence.echo is not None:
        echo = evidence.echo.of(floor.map_id)
    most = parameters.rule.most_log_odds
    return tuple(
        None if each is None else max(-most, min(most, each)) for each in (wifi, place, echo)
    )


def _denied(
    best: KnownFloor,
    known: Sequence[KnownFloor],
    said: Mapping[int, tuple[float | None, ...]],
    rule: RuleParameters,
) -> bool:
    """Whether a modality knows another building, and that it is not this, or nothing of this."""
    for sense, here in enumerate(said[best.number]):
        others = (said[each.number][sense] for each in known if each.building != best.building)
        another = max((odds for odds in others if odds is not None), default=0.0)
        if another >= rule.denying_log_odds and (here is None or here <= -rule.denying_log_odds):
            return True
    return False


Key = TypeVar("Key", int, str)
MOST_FLOORS = 64
"""So many of the likeliest by each modality are looked at by the others."""
POINTS = sa.select(
    FloorPoint.bssid, FloorPoint.floor, FloorPoint.level_dbm, FloorPoint.spread_db, FloorPoint.share
)
FLOORS = sa.select(
    Floor.number, Building.name, Floor.level, Floor.id, Floor.revision, Floor.has_wifi,
    Floor.latitude_deg, Floor.longitude_deg, Floor.radius_m, Floor.altitude_m,
).join(Building, Floor.building == Building.number)  # fmt: skip
AROUND = sa.and_(
    Floor.latitude_deg.between(sa.bindparam("south"), sa.bindparam("north")),
    sa.or_(
        Floor.longitude_deg.between(sa.bindparam("west"), sa.bindparam("east")),
        Floor.longitude_deg.between(sa.bindparam("west_too"), sa.bindparam("east_too")),
    ),
    sa.func.abs(Floor.latitude_deg - sa.bindparam("latitude", type_=sa.Float))
    * senses.EARTH_M_PER_DEG
    < Floor.radius_m + sa.bindparam("reach", type_=sa.Float),
)


@dataclass(frozen=True)
class Statements:
    """What is asked of a database, made once."""

    points: sa.Select[Any]
    by_number: sa.Select[Any]
    by_place: sa.Select[Any]
    by_both: sa.Select[Any]


def statements(*, arrays: bool) -> Statements:
    """With a list as one parameter, which can be prepared, or as one for each of its values."""

    def among(column: InstrumentedAttribute[Any], name: str, kind: Any) -> sa.ColumnElement[bool]:
        if arrays:
            return column == sa.any_(sa.bindparam(name, type_=sa.ARRAY(kind)))
        return column.in_(sa.bindparam(name, type_=kind, expanding=True))

    likely = sa.or_(
        among(Floor.number, "numbers", sa.Integer), among(Floor.id, "map_ids", sa.String)
    )
    points: Any = POINTS
    floors: Any = FLOORS
    return Statements(
        points.where(among(FloorPoint.bssid, "bssids", sa.BigInteger)),
        floors.where(likely),
        floors.where(AROUND),
        floors.where(sa.or_(likely, AROUND)),
    )


STATEMENTS = {arrays: statements(arrays=arrays) for arrays in (False, True)}


def _statements(connection: Connection) -> Statements:
    return STATEMENTS[connection.dialect.name == POSTGRESQL]


def find(
    connection: Connection, index: senses.EchoIndex | None, asked: Asked, parameters: FindParameters
) -> Answer:
    """Which floor a phone is on."""
    scan = senses.scan_of(asked.wifi, parameters.wifi)
    wifi = echo = None
    if len(scan.bssid):
        wifi = senses.wifi_log_odds(scan, _known_points(connection, scan), parameters.wifi)
    if asked.vectors is not None and index is not None and asked.encoder == index.encoder:
        echo = senses.echo_evidence(asked.vectors, index, parameters.echo)
    likely: dict[str, Sequence[object]] = {
        "numbers": _likeliest({} if wifi is None else wifi),
        "map_ids": _likeliest({} if echo is None else echo.odds),
    }
    floors = _floors(connection, likely, asked.place, parameters.position)
    silent = len(scan.bssid) * math.log(parameters.wifi.new_share)
    return decide(floors, Evidence(wifi, silent, asked.place, echo), parameters)


def _known_points(connection: Connection, scan: senses.Scan) -> senses.KnownPoints:
    rows = connection.execute(_statements(connection).points, {"bssids": scan.bssid.tolist()}).all()
    table = np.array([*map(tuple, rows)], dtype=np.float64).reshape(-1, 5)  # 48 bits are exact
    order = np.argsort(scan.bssid)
    heard = order[np.searchsorted(scan.bssid, table[:, 0].astype(np.int64), sorter=order)]
    return senses.KnownPoints(heard, table[:, 1].astype(np.int64), *table[:, 2:].T)


def _likeliest(odds: Mapping[Key, float]) -> list[Key]:
    return sorted(odds, key=lambda each: -odds[each])[:MOST_FLOORS]


def _floors(
    connection: Connection,
    likely: Mapping[str, Sequence[object]],
    place: senses.Place | None,
    parameters: senses.PositionFindParameters,
) -> list[KnownFloor]:
    """The floors of these numbers and maps, and those around a place."""
    wanted = _statements(connection)
    if place is None:
        rows = connection.execute(wanted.by_number, likely)
    elif any(likely.values()):
        rows = connection.execute(wanted.by_both, {**likely, **_around(place, parameters)})
    else:
        rows = connection.execute(wanted.by_place, _around(place, parameters))
    return [_known(row) for row in rows]


def _around(place: senses.Place, parameters: senses.PositionFindParameters) -> dict[str, float]:
    """The box around a place, and beyond the date line its other part."""
    south, west, north, east = senses.box_deg(place, parameters)
    turn = 360.0 if west < -180 else -360.0
    return {
        "south": south, "north": north, "west": west, "east": east,
        "west_too": west + turn, "east_too": east + turn,
        "latitude": place.latitude_deg, "reach": senses.reach_m(place, parameters),
    }  # fmt: skip


def _known(row: Sequence[Any]) -> KnownFloor:
    number, building, level, map_id, revision, has_wifi, *site = row
    return KnownFloor(number, building, level, map_id, revision, senses.Site(*site), has_wifi)


# --- the route of a phone that does not know where it is ---

router = APIRouter(tags=["buildings"])
MOST_POINTS, MOST_FOOTSTEPS = 1000, 32
PARAMETERS = FindParameters()
Bssid = Annotated[str, Field(pattern=f"^(?i:{senses.BSSID.pattern})$")]
Dbm = Annotated[float, Field(ge=-127, le=20)]
Unit = Annotated[float, Field(ge=-1.001, le=1.001)]


class Position(BaseModel):
    """Where the phone believes itself to be; sigma per axis."""

    latitude_deg: float = Field(ge=-senses.HIGHEST_DEG, le=senses.HIGHEST_DEG)
    longitude_deg: float = Field(ge=-180, le=180)
    sigma_m: float = Field(ge=1, le=2000)
    altitude_m: float | None = Field(default=None, ge=-1000, le=10_000)
    altitude_sigma_m: float | None = Field(default=None, ge=0.5, le=2000)


class Heard(BaseModel):
    """Features of some footsteps, and the identity of the encoder that made them."""

    encoder: str = Field(max_length=200)
    vectors: list[Annotated[list[Unit], Field(min_length=ELF_SIZE, max_length=ELF_SIZE)]] = Field(
        min_length=1, max_length=MOST_FOOTSTEPS
    )


class Question(BaseModel):
    """What a phone tells of where it is: any of these. Nothing of it is kept.

    `wifi`: the mean level of each access point that it hears, dBm by BSSID.
    """

    wifi: dict[Bssid, Dbm] = Field(default={}, max_length=MOST_POINTS)
    position: Position | None = None
    echoes: Heard | None = None

    @model_validator(mode="after")
    def _of_something(self) -> Question:
        if not self.wifi and self.position is None and self.echoes is None:
            raise ValueError("wanted wifi, position or echoes, got none of them")
        return self


class CandidateBody(BaseModel):
    """A floor: `map` is what to ask /api/maps/{map}/package for, `share` how likely it is."""

    building: str
    floor: int
    map: str
    revision: int
    share: float


class AnswerBody(BaseModel):
    """Candidates best first. Only with OK is the first one the place."""

    status: Found
    candidates: list[CandidateBody]


@router.post("/find", operation_id="find_floor", response_model=AnswerBody)
async def find_floor(question: Question, token: Token, services: ServicesDep) -> Response:
    """Which published floor a phone is on that hears this."""
    answer = partial(_answered, question, token, services)
    content = await to_thread.run_sync(answer, limiter=services.finders)
    return Response(content, media_type="application/json")


def _answered(question: Question, token: str, services: Services) -> str:
    """Everything that waits for the database, in one thread."""
    with looking(services.engine) as connection:
        admit(connection, token, services.token_rates)
        answer = find(connection, index_of(services), asked(question), PARAMETERS)
    return told(answer).model_dump_json()


def asked(question: Question) -> Asked:
    """A question as the lookup takes it."""
    place, echoes = question.position, question.echoes
    return Asked(
        {senses.checked_bssid_number(text): dbm for text, dbm in question.wifi.items()},
        None if place is None else senses.Place(**place.model_dump()),
        None if echoes is None else senses.unit_rows(np.array(echoes.vectors, dtype=np.float32)),
        "" if echoes is None else echoes.encoder,
    )


def told(answer: Answer) -> AnswerBody:
    """An answer as it is sent."""
    candidates = [
        CandidateBody(
            building=each.floor.building,
            floor=each.floor.level,
            map=each.floor.map_id,
            revision=each.floor.revision,
            share=round(each.share, 4),
        )
        for each in answer.candidates
    ]
    return AnswerBody(status=answer.status, candidates=candidates)
