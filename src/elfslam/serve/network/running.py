"""Runs the server: sockets, certificate, pairing address, and a stop that finishes its work.

The owner's token and the signing key pair phones. Both are looked at before anything is written:
whoever lost one of them decides what happens.
"""

import gc
import io
import os
import resource
import socket
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import segno
import uvicorn
from sqlalchemy import Engine, inspect, select
from sqlalchemy.engine import Connection
from starlette.types import ASGIApp

from elfslam.app.workers import why_away
from elfslam.base.errors import InputError, StoreError
from elfslam.base.text_files import read_bytes
from elfslam.serve.app import create_app
from elfslam.serve.buildings.files import open_files
from elfslam.serve.network import addresses
from elfslam.serve.network import authority as keys
from elfslam.serve.network.connections import CountingListener, PatientConfig, Visitors
from elfslam.serve.people.access import new_token, token_sha256
from elfslam.serve.people.users import add_user, set_owner_token
from elfslam.serve.problems import Problem
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import PORT, Limits, ServerSettings
from elfslam.serve.store.database import answering, reading, transaction
from elfslam.serve.store.opening import TRIES, alone_with, holding
from elfslam.serve.store.tables import Store, User
from elfslam.serve.texts import plain_line

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
            "it from a backup, or pair the owner's devices again with a new one",
            argument="new_token",
        )
    file = folder / keys.SIGNING_KEY
    here = keys.read_key(folder) if os.path.lexists(file) and not renews_key else None
    if not trusted or renews_key:
        return
    if here is None or keys.fingerprint(here) != trusted:
        raise StoreError(
            f"{file}: is {'another one' if here else 'missing'}, and paired phones trust what it "
            "signed; restore it from a backup, or pair all phones again with a new one",
            argument="new_key",
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
        keys.write_private(file, f"{token}\n".encode())
    with reading(services.sessions) as session:
        known = session.scalar(select(User.token_sha256).filter_by(is_owner=True))
    if known != token_sha256(token):
        set_owner_token(services, token)
    return token


def trust_key(services: Services, *, renewed: bool = False) -> None:
    """Remember which signing key phones trust from now on: that of the folder, or a new one."""
    folder = services.settings.authority_folder
    if renewed:
        (folder / keys.SIGNING_KEY).unlink(missing_ok=True)
    told = keys.fingerprint(keys.signing_key(folder))
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
            f"{file}: is damaged; restore it from a backup, or delete it for a new one",
            argument="new_token",
        )
    return text


STOP_S = 10
"""How long requests that are being answered may go on when the server is stopped."""
KEEP_ALIVE_S = 60
"""A phone that sends a piece now and then keeps its connection."""
AT_ONCE = 4
"""So many connections are accepted before those that are there get their next turn."""


def serve(
    app: ASGIApp,
    sockets: Sequence[socket.socket],
    limits: Limits,
    certificate: keys.Certificate | None,
    stopping: Callable[[], None],
) -> None:
    """Serve until stopped; plain HTTP without a certificate. `stopping` ends what has no end.

    That is spoken to a reverse proxy, at whose one address everybody is: only all are counted.
    """
    of_one = limits.connections if certificate is None else limits.address_connections
    visitors = Visitors(limits.connections, of_one)
    config = PatientConfig(
        visitors,
        limits,
        app=app,
        ws="none",
        log_config=None,  # as everybody else's
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=certificate is None,
        backlog=AT_ONCE,
        timeout_graceful_shutdown=STOP_S,
        timeout_keep_alive=KEEP_ALIVE_S,
        ssl_certfile=None if certificate is None else certificate.certificate,
        ssl_keyfile=None if certificate is None else certificate.key,
    )
    gc.freeze()  # what is there now stays, and need not be looked through
    secure = certificate is not None
    doors: list[socket.socket] = [
        CountingListener(each, visitors, speaks_tls=secure) for each in sockets
    ]
    StoppingServer(config, stopping).run(sockets=doors)


def allow_open_files(wanted: int) -> None:
    """Let this process open so many files at once. Raises InputError where it may not."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    unlimited = resource.RLIM_INFINITY
    if hard != unlimited and hard < wanted:
        raise InputError(
            f"this process may open {hard} files at once, wanted {wanted} for connections and "
            f"files; allow more, such as with ulimit -n {wanted}"
        )
    if soft != unlimited and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


class StoppingServer(uvicorn.Server):
    """uvicorn's server, which says that it stops before it waits for answers to end."""

    def __init__(self, config: uvicorn.Config, stopping: Callable[[], None]) -> None:
        super().__init__(config)
        self._stopping = stopping

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """As uvicorn does it, streams told to end."""
        self._stopping()
        await super().shutdown(sockets)


OTHER_FILES = 100
"""Of the database, jobs and uploads, beside one for each connection."""
TRUST = "trust"
"""The page that says how a device comes to trust the server."""


@dataclass(frozen=True)
class Listening:
    """Where and how to listen. Plain HTTP is spoken on loopback alone."""

    host: str | None = None
    port: int = PORT
    plain_http: bool = False
    new_token: bool = False
    new_key: bool = False
    address: str | None = None
    """Where other devices reach it: a host or a URL; None: the first that is found."""


def run(settings: ServerSettings, listening: Listening, say: Callable[[str], None]) -> None:
    """Serve until stopped: all that can be wrong is looked at first, and only then written.

    Raises InputError where it cannot listen, StoreError.
    """
    hosts, secure = _hosts(settings, listening), not listening.plain_http
    if listening.address:
        addresses.told_url(listening.address, listening.port or PORT, secure=secure)
    if settings.files_url:
        open_files(settings)
    allow_open_files(settings.limits.connections + OTHER_FILES)
    with alone_with(settings, TRIES), addresses.listening_at(hosts, listening.port) as sockets:
        examine = partial(_examine, folder=settings.authority_folder, listening=listening)
        services = open_services(settings, alone=True, examine=examine)
        with holding(services.sessions, settings):
            port = sockets[0].getsockname()[1]
            urls = [addresses.url_of(host, port, secure=secure) for host in hosts]
            if listening.address:
                urls.insert(0, addresses.told_url(listening.address, port, secure=secure))
            app, certificate = create_app(services), _certificate(settings, hosts, listening)
            for line in _begin(services, listening, urls, certificate):
                say(line)
            serve(app, sockets, settings.limits, certificate, services.stop)


def _examine(engine: Engine, folder: Path, listening: Listening) -> None:
    """Look at all keys before one of them is written. Raises StoreError, InputError."""
    renewed = {"renews_token": listening.new_token, "renews_key": listening.new_key}
    check_credentials(engine, folder, **renewed)
    if not listening.plain_http:
        keys.check_authority(folder)


def _begin(
    services: Services,
    listening: Listening,
    urls: Sequence[str],
    certificate: keys.Certificate | None,
) -> Iterator[str]:
    """Write what pairs phones, and say what people have to know."""
    settings = services.settings
    token = owner_token(services, renewed=listening.new_token)
    trust_key(services, renewed=listening.new_key)
    addresses.remember_url(settings, urls[0])
    pairing = urls[0] + keys.pairing_fragment(token, settings.authority_folder)
    yield from greeting(urls, pairing, certificate)
    if settings.run_jobs and (why := why_away(settings.on)):
        yield f"Jobs wait until a Ray cluster answers at {settings.on} ({why})."


def invite(settings: ServerSettings, name: str) -> tuple[str, str]:
    """Let somebody in: their name and the address that pairs their phone. Raises InputError."""
    services = open_services(settings)
    try:
        with answering(services.engine):
            user, token = add_user(services, plain_line(name))
    except (ValueError, Problem) as error:
        raise InputError(f"{name!r:.60}: {getattr(error, 'detail', error)}") from error
    return user.name, addresses.last_url(settings) + keys.pairing_fragment(
        token, settings.authority_folder
    )


def greeting(urls: Sequence[str], pairing: str, certificate: keys.Certificate | None) -> list[str]:
    """What is said when the server starts: the address that pairs, its QR code, the authority.

    The first of the `urls` is the one of `pairing`.
    """
    lines = [pairing, *code_lines(pairing)]
    url, *others = [each for each in urls if not addresses.reaches_nobody(each)] or urls[:1]
    if not addresses.reaches_nobody(url):
        lines.append(f"Scan this with the phone, or open {url} there.")
    if others:
        lines.append(f"Where the phone is in another network: {', '.join(others)} (--address)")
    if certificate is not None:
        lines.append(
            f"Browsers warn once, as they do not know this server; {url}{TRUST} says how to make "
            "them trust it. Its authority's fingerprint (SHA-256):"
        )
        lines.append(keys.fingerprint_of(certificate.certificate.with_name(keys.AUTHORITY)))
    return lines


def code_lines(url: str) -> list[str]:
    """A QR code for the terminal; of an address that leads a phone to itself, why there is none."""
    return (
        [f"No code to scan: {addresses.ALONE}"] if addresses.reaches_nobody(url) else qr_lines(url)
    )


def qr_lines(text: str) -> list[str]:
    """A QR code for the terminal, two rows of it in a line."""
    drawn = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(drawn, border=2, compact=True)
    return drawn.getvalue().rstrip("\n").split("\n")


def _hosts(settings: ServerSettings, listening: Listening) -> list[str]:
    if not listening.plain_http:
        return addresses.checked_hosts(listening.host, allow_public=settings.allow_public)
    hosts = addresses.checked_hosts(listening.host or addresses.LOOPBACK, allow_public=False)
    if not all(host.startswith("127.") or host == "::1" for host in hosts):
        raise InputError(
            f"{listening.host}: plain HTTP is spoken on this machine alone; choose HTTPS",
            argument="host",
        )
    return hosts


def _certificate(
    settings: ServerSettings, hosts: Sequence[str], listening: Listening
) -> keys.Certificate | None:
    if listening.plain_http:
        return None
    names = addresses.server_names([*hosts, *settings.names])
    return keys.server_certificate(settings.authority_folder, names, keys.utc_now())
