"""What pairs phones: the owner's token, and the signing key that they trust; both beside the keys.

Looked at before anything is written: whoever lost one of them decides what happens.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from sqlalchemy import Engine, inspect, select
from sqlalchemy.engine import Connection

from elfslam.base.errors import StoreError
from elfslam.base.text_files import read_bytes
from elfslam.serve.network.authority import write_private
from elfslam.serve.network.signing import SIGNING_KEY, fingerprint, read_key, signing_key
from elfslam.serve.people.access import new_token, token_sha256
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.services import Services
from elfslam.serve.store.database import Store, User, answering, reading, transaction

OWNER_TOKEN = "owner.token"
MOST_TOKEN_BYTES = 1000


def check_credentials(
    engine: Engine, folder: Path, *, renews_token: bool, renews_key: bool
) -> None:
    """Raise StoreError where the owner's token or the signing key is not the one in use.

    `folder` is that of the authority, `engine` a database of whatever version.
    """
    with answering(engine), engine.connect() as connection:
        owner = _told(connection, User.token_sha256, User.is_owner)
        trusted = _told(connection, Store.signing_key, None)
    token = _read_token(folder / OWNER_TOKEN)
    if owner and not renews_token and (token is None or token_sha256(token) != owner):
        raise StoreError(
            f"{folder / OWNER_TOKEN}: is {'missing' if token is None else 'another one'}; restore "
            "it from a backup, or pair the owner's devices again with --new-token"
        )
    here = read_key(folder) if os.path.lexists(folder / SIGNING_KEY) and not renews_key else None
    if not trusted or renews_key:
        return
    if here is None or fingerprint(here) != trusted:
        raise StoreError(
            f"{folder / SIGNING_KEY}: is {'another one' if here else 'missing'}, and paired phones "
            "trust what it signed; restore it from a backup, or pair all phones again with "
            "--new-key"
        )


def _told(connection: Connection, wanted: Any, condition: Any) -> str | None:
    """The value of a column, where a database of that version has it and a row."""
    table = wanted.class_.__tablename__
    inspector = inspect(connection)
    if not inspector.has_table(table):
        return None
    if wanted.key not in {each["name"] for each in inspector.get_columns(table)}:
        return None
    query = select(wanted) if condition is None else select(wanted).where(condition)
    found: str | None = connection.execute(query).scalar()
    return found


def owner_token(services: Services, *, renewed: bool = False) -> str:
    """The owner's token, kept so that every start shows the same address."""
    file = services.settings.authority_folder / OWNER_TOKEN
    token = None if renewed else _read_token(file)
    if token is None:
        token = new_token()
        write_private(file, f"{token}\n".encode())
    with reading(services.sessions) as session:
        known = session.scalar(select(User.token_sha256).filter_by(is_owner=True))
    if known != token_sha256(token):
        set_owner_token(services, token)
    return token


def trust_key(services: Services, *, renewed: bool = False) -> None:
    """Remember which signing key phones trust from now on: that of the folder, or a new one."""
    folder = services.settings.authority_folder
    if renewed:
        (folder / SIGNING_KEY).unlink(missing_ok=True)
    told = fingerprint(signing_key(folder))
    with reading(services.sessions) as session:
        if session.scalar(select(Store.signing_key)) == told:
            return
    with transaction(services.sessions) as session:
        session.scalars(select(Store)).one().signing_key = told


def _read_token(file: Path) -> str | None:
    """A token, None where there is none. Raises StoreError for anything else."""
    if not os.path.lexists(file):
        return None
    text = read_bytes(file, MOST_TOKEN_BYTES).decode("ascii", "replace").strip()
    if not text or not text.replace("-", "").replace("_", "").isalnum() or not text.isascii():
        raise StoreError(
            f"{file}: is damaged; restore it from a backup, or delete it and say --new-token"
        )
    return text
