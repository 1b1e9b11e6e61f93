"""Runs the server: sockets, certificate, pairing address, and a stop that finishes its work."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import segno
from sqlalchemy import Engine

from elfslam.app.workers import why_away
from elfslam.base.errors import InputError
from elfslam.serve.app import create_app
from elfslam.serve.buildings.files import open_files
from elfslam.serve.network.addresses import (
    LOOPBACK,
    checked_hosts,
    listening_at,
    server_names,
    url_of,
)
from elfslam.serve.network.authority import (
    AUTHORITY,
    Certificate,
    check_authority,
    fingerprint_of,
    server_certificate,
    utc_now,
)
from elfslam.serve.network.credentials import (
    check_credentials,
    owner_token,
    trust_key,
)
from elfslam.serve.network.reach import (
    ALONE,
    last_url,
    reaches_nobody,
    remember_url,
    told_url,
)
from elfslam.serve.network.serving import allow_open_files, serve
from elfslam.serve.network.signing import pairing_fragment
from elfslam.serve.people.users import add_user
from elfslam.serve.problems import Problem
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import PORT, ServerSettings
from elfslam.serve.store.database import answering
from elfslam.serve.store.holding import holding
from elfslam.serve.store.opening import TRIES, alone_with
from elfslam.serve.texts import plain_line

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
        told_url(listening.address, listening.port or PORT, secure=secure)
    if settings.files_url:
        open_files(settings)
    allow_open_files(settings.limits.connections + OTHER_FILES)
    with alone_with(settings, TRIES), listening_at(hosts, listening.port) as sockets:
        examine = partial(_examine, folder=settings.authority_folder, listening=listening)
        services = open_services(settings, alone=True, examine=examine)
        with holding(services.sessions, settings):
            port = sockets[0].getsockname()[1]
            urls = [url_of(host, port, secure=secure) for host in hosts]
            if listening.address:
                urls.insert(0, told_url(listening.address, port, secure=secure))
            app, certificate = create_app(services), _certificate(settings, hosts, listening)
            for line in _begin(services, listening, urls, certificate):
                say(line)
            serve(app, sockets, settings.limits, certificate, services.stop)


def _examine(engine: Engine, folder: Path, listening: Listening) -> None:
    """Look at all keys before one of them is written. Raises StoreError, InputError."""
    renewed = {"renews_token": listening.new_token, "renews_key": listening.new_key}
    check_credentials(engine, folder, **renewed)
    if not listening.plain_http:
        check_authority(folder)


def _begin(
    services: Services,
    listening: Listening,
    urls: Sequence[str],
    certificate: Certificate | None,
) -> Iterator[str]:
    """Write what pairs phones, and say what people have to know."""
    settings = services.settings
    token = owner_token(services, renewed=listening.new_token)
    trust_key(services, renewed=listening.new_key)
    remember_url(settings, urls[0])
    pairing = urls[0] + pairing_fragment(token, settings.authority_folder)
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
    return user.name, last_url(settings) + pairing_fragment(token, settings.authority_folder)


def greeting(urls: Sequence[str], pairing: str, certificate: Certificate | None) -> list[str]:
    """What is said when the server starts: the address that pairs, its QR code, the authority.

    The first of the `urls` is the one of `pairing`.
    """
    lines = [pairing, *code_lines(pairing)]
    url, *others = [each for each in urls if not reaches_nobody(each)] or urls[:1]
    if not reaches_nobody(url):
        lines.append(f"Scan this with the phone, or open {url} there.")
    if others:
        lines.append(f"Where the phone is in another network: {', '.join(others)} (--address)")
    if certificate is not None:
        lines.append(
            f"Browsers warn once, as they do not know this server; {url}{TRUST} says how to make "
            "them trust it. Its authority's fingerprint (SHA-256):"
        )
        lines.append(fingerprint_of(certificate.certificate.with_name(AUTHORITY)))
    return lines


def code_lines(url: str) -> list[str]:
    """A QR code for the terminal; of an address that leads a phone to itself, why there is none."""
    return [f"No code to scan: {ALONE}"] if reaches_nobody(url) else qr_lines(url)


def qr_lines(text: str) -> list[str]:
    """A QR code for the terminal, two rows of it in a line."""
    drawn = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(drawn, border=2, compact=True)
    return drawn.getvalue().rstrip("\n").split("\n")


def _hosts(settings: ServerSettings, listening: Listening) -> list[str]:
    if not listening.plain_http:
        return checked_hosts(listening.host, allow_public=settings.allow_public)
    hosts = checked_hosts(listening.host or LOOPBACK, allow_public=False)
    if not all(host.startswith("127.") or host == "::1" for host in hosts):
        raise InputError(
            f"--host {listening.host}: plain HTTP is spoken on this machine alone; leave --http out"
        )
    return hosts


def _certificate(
    settings: ServerSettings, hosts: Sequence[str], listening: Listening
) -> Certificate | None:
    if listening.plain_http:
        return None
    names = server_names([*hosts, *settings.names])
    return server_certificate(settings.authority_folder, names, utc_now())
