"""Routes of a phone that does not know where it is: which floor it is on."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import numpy as np
from anyio import to_thread
from fastapi import APIRouter, Response
from pydantic import BaseModel, Field, model_validator

from elfslam.base.values import ELF_SIZE
from elfslam.serve.buildings.find import Answer, Asked, FindParameters, Found, find
from elfslam.serve.buildings.indexes import index_of
from elfslam.serve.buildings.senses import (
    BSSID,
    HIGHEST_DEG,
    Place,
    checked_bssid_number,
    unit_rows,
)
from elfslam.serve.people.access import Token, admit
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.store.database import looking

router = APIRouter(tags=["buildings"])
MOST_POINTS, MOST_FOOTSTEPS = 1000, 32
PARAMETERS = FindParameters()
Bssid = Annotated[str, Field(pattern=f"^(?i:{BSSID.pattern})$")]
Dbm = Annotated[float, Field(ge=-127, le=20)]
Unit = Annotated[float, Field(ge=-1.001, le=1.001)]


class Position(BaseModel):
    """Where the phone believes itself to be; sigma per axis."""

    latitude_deg: float = Field(ge=-HIGHEST_DEG, le=HIGHEST_DEG)
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
        {checked_bssid_number(text): dbm for text, dbm in question.wifi.items()},
        None if place is None else Place(**place.model_dump()),
        None if echoes is None else unit_rows(np.array(echoes.vectors, dtype=np.float32)),
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
