"""Who asks: a user by their pairing token, in a header or in a cookie."""

import hashlib
import hmac
import math
import re
import secrets
from typing import Annotated, TypeVar

from fastapi import Depends, Security
from fastapi.security import APIKeyCookie, HTTPAuthorizationCredentials, HTTPBearer
from sqlalchemy import bindparam, select
from sqlalchemy.engine import Connection
from sqlalchemy.orm import Session

from elfslam.serve.problems import Problem
from elfslam.serve.services import Rates, ServicesDep
from elfslam.serve.settings import COOKIE
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import Job, Recording, Upload, User, UserGroup

TOKEN_BYTES = 32
KNOWN = select(User.id).where(User.token_sha256 == bindparam("sha256"))
NOT_KNOWN = "this pairing token is not known here; ask for a new one"
NOTHING_SENT = "no pairing token was sent; open the address of the QR code again"
ID = re.compile(r"[0-9a-f]{32}")
BEARER = HTTPBearer(auto_error=False, description="The pairing token of the QR code.")
IN_COOKIE = APIKeyCookie(name=COOKIE, auto_error=False, description="The same, as a cookie.")


def new_token() -> str:
    """A pairing token: 32 random bytes."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def token_sha256(token: str) -> str:
    """What the database keeps of a token."""
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


def user_of_token(session: Session, token: str) -> User | None:
    """Whose token that is."""
    wanted = token_sha256(token)
    user = session.scalar(select(User).where(User.token_sha256 == wanted))
    return user if user and hmac.compare_digest(user.token_sha256, wanted) else None


async def given_token(
    bearer: Annotated[HTTPAuthorizationCredentials | None, Security(BEARER)],
    cookie: Annotated[str | None, Security(IN_COOKIE)],
) -> str:
    """The token of a request; that of the header counts. Raises Problem 401."""
    token = bearer.credentials if bearer else cookie
    if not token:
        raise unknown_token(NOTHING_SENT)
    return token


Token = Annotated[str, Depends(given_token)]
"""A route's parameter: the token that was sent, not checked yet."""


def current_user(token: Token, services: ServicesDep) -> User:
    """The user who asks. Raises Problem 401 for an unknown token, 429 for too many requests."""
    with reading(services.sessions) as session:
        user = user_of_token(session, token)
    if user is None:
        raise unknown_token(NOT_KNOWN)
    refuse_haste(services.token_rates.take(user.id))
    return user


def admit(connection: Connection, token: str, rates: Rates) -> None:
    """Let whoever has a token pass, for routes that have a connection in hand.

    Raises Problem 401 and 429 as `current_user` does.
    """
    user_id = connection.execute(KNOWN, {"sha256": token_sha256(token)}).scalar()
    if user_id is None:
        raise unknown_token(NOT_KNOWN)
    refuse_haste(rates.take(user_id))


Me = Annotated[User, Depends(current_user)]
"""A route's parameter: the user who asks."""


async def owner(user: Me) -> User:
    """The user who asks, if they own the server. Raises Problem 403."""
    if not user.is_owner:
        raise Problem(403, "only the owner of this server may do that; ask them")
    return user


Owner = Annotated[User, Depends(owner)]
"""A route's parameter: the owner, who asks."""


def refuse_haste(wait_s: float) -> None:
    """Raise Problem 429 where somebody has to wait."""
    if wait_s > 0:
        seconds = max(1, math.ceil(wait_s))
        raise Problem(429, f"too many requests; wait {seconds} s", {"Retry-After": str(seconds)})


def known_id(text: str, what: str) -> str:
    """An id as we make them. Raises Problem 404 for anything else."""
    if not ID.fullmatch(text):
        raise not_found(what)
    return text


Owned = TypeVar("Owned", Job, Recording, Upload, UserGroup)


def own(
    session: Session, kind: type[Owned], row_id: str, user: User, what: str, *, lock: bool = False
) -> Owned:
    """What of that kind is the user's. Raises Problem 404."""
    row = session.get(kind, known_id(row_id, what), with_for_update=lock)
    if row is None or row.user_id != user.id:
        raise not_found(what)
    return row


def not_found(what: str) -> Problem:
    """The refusal for what is not there, or is somebody else's."""
    return Problem(404, f"there is no such {what} here; it may have been deleted")


def unknown_token(detail: str) -> Problem:
    """The refusal for who has no token, or one that is not known."""
    return Problem(401, detail, {"WWW-Authenticate": "Bearer"})
