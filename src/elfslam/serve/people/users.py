"""Routes of users: who I am, one more device of mine, and whom the owner lets in."""

from dataclasses import asdict
from datetime import datetime

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from elfslam.serve.network.addresses import url_for_others
from elfslam.serve.network.authority import pairing_fragment
from elfslam.serve.people import access
from elfslam.serve.problems import EVERYWHERE, Problem, problems
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.settings import COOKIE, ServerSettings
from elfslam.serve.store.database import count_rows, reading, transaction
from elfslam.serve.store.quota import delete_user, used_bytes
from elfslam.serve.store.tables import User
from elfslam.serve.texts import Line

router = APIRouter(tags=["users"])
ONE_YEAR_S = 365 * 24 * 3600


class MeBody(BaseModel):
    """Who asks, and what they may."""

    id: str
    name: str
    is_owner: bool
    used_bytes: int
    limits: dict[str, float]


class UserBody(BaseModel):
    """A user, as the owner sees them."""

    id: str
    name: str
    is_owner: bool
    created_utc: datetime


class PersonBody(BaseModel):
    """Somebody with whom a map can be shared."""

    id: str
    name: str


class UserName(BaseModel):
    """What somebody is called."""

    name: Line


class Invitation(BaseModel):
    """The token of a new user: told once, kept nowhere."""

    id: str
    name: str
    token: str
    url: str


@router.post("/session", status_code=204, operation_id="begin_session")
def begin_session(_user: access.Me, token: access.Token, services: ServicesDep) -> Response:
    """Keep the token of the Authorization header as a cookie that scripts cannot read."""
    return session_of(token, services.settings)


def session_of(token: str, settings: ServerSettings) -> Response:
    """The answer that keeps a token as a cookie."""
    response = Response(status_code=204)
    response.set_cookie(
        COOKIE,
        token,
        max_age=ONE_YEAR_S,
        httponly=True,
        secure=settings.secure_cookie,
        samesite="strict",
    )
    return response


@router.delete("/session", status_code=204, operation_id="end_session")
def end_session(_user: access.Me, services: ServicesDep) -> Response:
    """Forget the cookie on this device; the token stays valid."""
    response = Response(status_code=204)
    response.delete_cookie(
        COOKIE, httponly=True, secure=services.settings.secure_cookie, samesite="strict"
    )
    return response


@router.get("/me", operation_id="who_am_i")
def who_am_i(user: access.Me, services: ServicesDep) -> MeBody:
    """The user whose token was sent, what they use and what they may."""
    with reading(services.sessions) as session:
        return _me(services, session, user)


@router.patch("/me", operation_id="rename_me")
def rename_me(given: UserName, mine: access.Me, services: ServicesDep) -> MeBody:
    """Be called otherwise: others see the name where a map is shared."""
    with transaction(services.sessions) as session:
        user = session.get(User, mine.id)
        if user is None:
            raise access.not_found("user")
        user.name = given.name
        return _me(services, session, user)


def _me(services: Services, session: Session, user: User) -> MeBody:
    return MeBody(
        id=user.id,
        name=user.name,
        is_owner=user.is_owner,
        used_bytes=used_bytes(services, session, user.id),
        limits=asdict(services.settings.limits),
    )


@router.get("/people", operation_id="list_people")
def list_people(user: access.Me, services: ServicesDep) -> list[PersonBody]:
    """Everybody else who has a token, by name: with them a map can be shared."""
    others = select(User).where(User.id != user.id).order_by(User.name, User.id)
    with reading(services.sessions) as session:
        rows = session.scalars(others)
        return [PersonBody.model_validate(each, from_attributes=True) for each in rows]


@router.get("/users", operation_id="list_users")
def list_users(_owner: access.Owner, services: ServicesDep) -> list[UserBody]:
    """Everybody who has a token (owner only)."""
    with reading(services.sessions) as session:
        users = session.scalars(select(User).order_by(User.created_utc, User.id))
        return [UserBody.model_validate(user, from_attributes=True) for user in users]


@router.post("/users", status_code=201, operation_id="invite_user", responses=problems(409))
def invite_user(
    given: UserName, _owner: access.Owner, services: ServicesDep, request: Request
) -> Invitation:
    """Let somebody in: their token is in the answer and nowhere else (owner only)."""
    url = url_for_others(str(request.base_url), services.settings)
    user, token = add_user(services, given.name)
    fragment = pairing_fragment(token, services.settings.authority_folder)
    return Invitation(id=user.id, name=user.name, token=token, url=url + fragment)


@router.delete(
    "/users/{user_id}", status_code=204, operation_id="delete_user", responses=problems(409)
)
def remove_user(user_id: str, mine: access.Owner, services: ServicesDep) -> None:
    """Delete a user with all their recordings, maps and jobs (owner only)."""
    if access.known_id(user_id, "user") == mine.id:
        raise Problem(409, "the owner cannot be deleted; delete the data folder instead")
    with reading(services.sessions) as session:
        if session.get(User, user_id) is None:
            raise access.not_found("user")
    delete_user(services, user_id)


def add_user(services: Services, name: str) -> tuple[User, str]:
    """A new user and their token. Raises Problem 409 where there are too many."""
    token, most = access.new_token(), services.settings.limits.users
    with transaction(services.sessions) as session:
        if count_rows(session, User) >= most:
            raise Problem(409, f"there are {most} users already; delete one first")
        user = User(name=name, token_sha256=access.token_sha256(token))
        session.add(user)
    return user, token


def set_owner_token(services: Services, token: str) -> User:
    """The owner, made where there is none, with this token from now on."""
    with transaction(services.sessions) as session:
        user = session.scalar(select(User).filter_by(is_owner=True))
        if user is None:
            user = User(name="owner", token_sha256="", is_owner=True)
            session.add(user)
        user.token_sha256 = access.token_sha256(token)
    return user


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
def pair_device(
    _user: access.Me, token: access.Token, services: ServicesDep, request: Request
) -> PairingCode:
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
