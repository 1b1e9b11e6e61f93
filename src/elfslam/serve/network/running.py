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
    open_sockets,
    server_names,
    url_of,
)
from elfslam.serve.network.authority import (
    AUTHORITY,
    Certificate,
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
from elfslam.serve.network.serving import serve
from elfslam.serve.network.signing import pairing_fragment
from elfslam.serve.people.users import add_user
from elfslam.serve.problems import Problem
from elfslam.serve.services import open_services
from elfslam.serve.settings import PORT, ServerSettings
from elfslam.serve.store.opening import TRIES, alone_with
from elfslam.serve.texts import plain_line

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
    """Serve until stopped: lock, identity, version, credentials, sockets, and only then writing.

    Raises InputError where it cannot listen, StoreError.
    """
    hosts = _hosts(settings, listening)
    with alone_with(settings, TRIES):
        services = open_services(settings, alone=True)
        check_credentials(services, renews_token=listening.new_token, renews_key=listening.new_key)
        sockets = open_sockets(hosts, listening.port)
        port, secure = sockets[0].getsockname()[1], not listening.plain_http
        urls = [url_of(host, port, secure=secure) for host in hosts]
        if listening.address:
            urls.insert(0, told_url(listening.address, port, secure=secure))
        url = urls[0]
        app, certificate = create_app(services), _certificate(settings, hosts, listening)
        token = owner_token(services, renewed=listening.new_token)
        trust_key(services, renewed=listening.new_key)
        remember_url(settings, url)
        pairing = url + pairing_fragment(token, settings.authority_folder)
        for line in greeting(urls, pairing, certificate):
            say(line)
        serve(app, sockets, settings.limits, certificate, services.stop)


def invite(settings: ServerSettings, name: str) -> tuple[str, str]:
    """Let somebody in: their name and the address that pairs their phone. Raises InputError."""
    try:
        user, token = add_user(open_services(settings), plain_line(name))
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
