"""Runs the server: sockets, certificate, pairing address, and a stop that finishes its work."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import segno
import uvicorn
from sqlalchemy import select

from elfslam.base.errors import InputError
from elfslam.data.folders import new_file
from elfslam.serve.app import create_app
from elfslam.serve.network.addresses import (
    LOOPBACK,
    checked_hosts,
    lan_addresses,
    open_sockets,
    server_names,
    url_of,
)
from elfslam.serve.network.authority import AUTHORITY, server_certificate, utc_now
from elfslam.serve.network.signing import pairing_fragment
from elfslam.serve.people.access import new_token, token_sha256
from elfslam.serve.people.users import add_user, set_owner_token
from elfslam.serve.problems import Problem
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import PORT, ServerSettings
from elfslam.serve.store.database import User, reading
from elfslam.serve.texts import plain_line

OWNER_TOKEN = "owner.token"
LAST_URL = "url"
STOP_S = 10
"""How long requests that are being answered may go on when the server is stopped."""
KEEP_ALIVE_S = 60
"""A phone that sends a piece now and then keeps its connection."""
MOST_CONNECTIONS = 500


@dataclass(frozen=True)
class Listening:
    """Where and how to listen. Plain HTTP is spoken on loopback alone."""

    host: str | None = None
    port: int = PORT
    plain_http: bool = False
    new_token: bool = False


def run(settings: ServerSettings, listening: Listening, say: Callable[[str], None]) -> None:
    """Serve until stopped. Raises InputError where it cannot listen, StoreError."""
    app = create_app(settings)
    hosts = _hosts(settings, listening)
    sockets = open_sockets(hosts, listening.port)
    port = sockets[0].getsockname()[1]
    url = url_of(hosts[0], port, secure=not listening.plain_http)
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=listening.plain_http,
        timeout_graceful_shutdown=STOP_S,
        timeout_keep_alive=KEEP_ALIVE_S,
        limit_concurrency=MOST_CONNECTIONS,
    )
    if not listening.plain_http:
        names = server_names(hosts)
        kept = server_certificate(settings.authority_folder, names, utc_now())
        config.ssl_certfile, config.ssl_keyfile = kept.certificate, kept.key
    token = owner_token(app.state.services, renewed=listening.new_token)
    _write(settings.authority_folder / LAST_URL, url)
    pairing = url + pairing_fragment(token, settings.authority_folder)
    for line in greeting(url, pairing, secure=not listening.plain_http):
        say(line)
    uvicorn.Server(config).run(sockets=sockets)


def invite(settings: ServerSettings, name: str) -> tuple[str, str]:
    """Let somebody in: their name and the address that pairs their phone. Raises InputError."""
    try:
        user, token = add_user(open_services(settings), plain_line(name))
    except (ValueError, Problem) as error:
        raise InputError(f"{name!r:.60}: {getattr(error, 'detail', error)}") from error
    return user.name, _last_url(settings) + pairing_fragment(token, settings.authority_folder)


def greeting(url: str, pairing: str, *, secure: bool) -> list[str]:
    """What is said when the server starts: the address that pairs, its QR code, the authority."""
    lines = [pairing, *qr_lines(pairing), f"Scan this with the phone, or open {url} there."]
    if secure:
        lines.append(
            f"Browsers warn once, as they do not know this server; {url}{AUTHORITY} installs its "
            "authority for good."
        )
    return lines


def qr_lines(text: str) -> list[str]:
    """A QR code for the terminal, two rows of it in a line."""
    drawn = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(drawn, border=2, compact=True)
    return drawn.getvalue().rstrip("\n").split("\n")


def owner_token(services: Services, *, renewed: bool = False) -> str:
    """The owner's token, kept beside the keys so that every start shows the same address."""
    file = services.settings.authority_folder / OWNER_TOKEN
    token = file.read_text().strip() if file.is_file() and not renewed else ""
    with reading(services.sessions) as session:
        known = session.scalar(select(User.token_sha256).filter_by(is_owner=True))
    if not token or known != token_sha256(token):
        token = new_token() if renewed or not token else token
        _write(file, token)
        set_owner_token(services, token)
    return token


def _hosts(settings: ServerSettings, listening: Listening) -> list[str]:
    if not listening.plain_http:
        return checked_hosts(listening.host, allow_public=settings.allow_public)
    hosts = checked_hosts(listening.host or LOOPBACK, allow_public=False)
    if not all(host.startswith("127.") or host == "::1" for host in hosts):
        raise InputError(
            f"--host {listening.host}: plain HTTP is spoken on this machine alone; leave --http out"
        )
    return hosts


def _last_url(settings: ServerSettings) -> str:
    """Where the server was reached last, or will be."""
    file = settings.authority_folder / LAST_URL
    if file.is_file():
        return file.read_text().strip()
    return url_of([*lan_addresses(), LOOPBACK][0], PORT, secure=True)


def _write(file: Path, text: str) -> None:
    with new_file(file) as partial:
        partial.touch(mode=0o600)
        partial.write_text(text + "\n")
