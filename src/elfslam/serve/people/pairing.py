"""One more device of who is here: a code that opens a session once, within ten minutes."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from elfslam.serve.network.reach import url_for_others
from elfslam.serve.network.signing import pairing_fragment
from elfslam.serve.people.access import Me, Token
from elfslam.serve.people.users import session_of
from elfslam.serve.problems import EVERYWHERE, Problem, problems
from elfslam.serve.services import ServicesDep

router = APIRouter(tags=["users"])
public = APIRouter(tags=["users"])
"""For who has nothing but a code."""


class PairingCode(BaseModel):
    """The address that pairs another device: once, and for so many seconds."""

    url: str
    expires_s: float


class GivenCode(BaseModel):
    """A code from the address that `POST /api/pairing` gave."""

    code: str = Field(max_length=100)


@router.post("/pairing", status_code=201, operation_id="pair_device", responses=problems(409))
def pair_device(_user: Me, token: Token, services: ServicesDep, request: Request) -> PairingCode:
    """An address that pairs one more device with whoever asks; its code is used up by that."""
    url = url_for_others(str(request.base_url), services.settings)
    code = services.codes.make(token)
    fragment = pairing_fragment(code, services.settings.authority_folder, name="code")
    return PairingCode(url=url + fragment, expires_s=services.codes.lasts_s)


@public.post(
    "/session/code", status_code=204, operation_id="begin_session_by_code", responses=EVERYWHERE
)
def begin_session_by_code(given: GivenCode, services: ServicesDep) -> Response:
    """Redeem a code for a cookie that scripts cannot read."""
    token = services.codes.redeem(given.code)
    if token is None:
        raise Problem(401, "this code was used or is too old; make another one at the desk")
    return session_of(token, services.settings)
