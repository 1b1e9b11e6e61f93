"""Runs the server: sockets, certificate, pairing address, and a stop that finishes its work."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import segno

from elfslam.base.errors import InputError
from elfslam.serve.app import create_app
from elfslam.serve.network.addresses import (
    LOOPBACK,
    checked_hosts,
    lan_addresses,
    open_sockets,
    server_names,
    url_of,
)
from elfslam.serve.network.authority import (
    AUTHORITY,
    Certificate,
    server_certificate,
    utc_now,
)
from elfslam.serve.network.credentials import (
    check_credentials,
    owner_token,
    trust_key,
    write_private,
)
from elfslam.serve.network.serving import serve
from elfslam.serve.network.signing import pairing_fragment
from elfslam.serve.people.users import add_user
from elfslam.serve.problems import Problem
from elfslam.serve.services import open_services
from elfslam.serve.settings import PORT, ServerSettings
from elfslam.serve.store.opening import TRIES, alone_with
from elfslam.serve.texts import plain_line

LAST_URL = "url"


@dataclass(frozen=True)
class Listening:
    """Where and how to listen. Plain HTTP is spoken on loopback alone."""

    host: str | None = None
    port: int = PORT
    plain_http: bool = False
    new_token: bool = False
    new_key: bool = False


def run(settings: ServerSettings, listening: Listening, say: Callable[[str], None]) -> None:
    """Serve until stopped: lock, identity, version, credentials, sockets, and only then writing.

    Raises InputError where it cannot listen, StoreError.
    """
    hosts = _hosts(settings, listening)
    with alone_with(settings, TRIES):
        services = open_services(settings, alone=True)
        check_credentials(services, renews_token=listening.new_token, renews_key=listening.new_key)
        sockets = open_sockets(hosts, listening.port)
        url = url_of(hosts[0], sockets[0].getsockname()[1], secure=not listening.plain_http)
        app, certificate = create_app(services), _certificate(settings, hosts, listening)
        token = owner_token(services, renewed=listening.new_token)
        trust_key(services, renewed=listening.new_key)
        write_private(settings.authority_folder / LAST_URL, url)
        pairing = url + pairing_fragment(token, settings.authority_folder)
        for line in greeting(url, pairing, secure=not listening.plain_http):
            say(line)
        serve(app, sockets, settings.limits, certificate)


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


def _last_url(settings: ServerSettings) -> str:
    """Where the server was reached last, or will be."""
    file = settings.authority_folder / LAST_URL
    if file.is_file():
        return file.read_text().strip()
    return url_of([*lan_addresses(), LOOPBACK][0], PORT, secure=True)
