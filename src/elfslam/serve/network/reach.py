"""The address at which other devices reach this server: what QR codes and invitations hold."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from urllib.parse import urlsplit

from elfslam.base.errors import InputError
from elfslam.serve.network.addresses import LOOPBACK, lan_addresses, url_of
from elfslam.serve.network.authority import write_private
from elfslam.serve.network.names import HOST
from elfslam.serve.problems import Problem
from elfslam.serve.settings import PORT, ServerSettings

LAST_URL = "url"
ALONE = (
    "no other device reaches this server: this machine is in no local network; connect it to the "
    "phone's network and start again, or say --address"
)


def told_url(address: str, port: int, *, secure: bool) -> str:
    """The URL of what somebody gave as --address: a host, or a whole URL. Raises InputError."""
    host = address.strip("[]") if address.count(":") > 1 else address
    whole = address if "://" in address else url_of(host, port, secure=secure)
    try:
        parts = urlsplit(whole)
        plain = parts.scheme in ("http", "https") and HOST.fullmatch(parts.netloc.lower())
        good = plain and parts.port != 0 and not (parts.query or parts.fragment)
        good = good and ("://" in address or parts.path == "/")
    except ValueError:
        good = False
    if not good or any(character.isspace() for character in whole):
        raise InputError(
            f"--address {address!r:.60}: wanted a host or https://HOST/, such as 192.168.1.7"
        )
    return whole.rstrip("/") + "/"


def reaches_nobody(url: str) -> bool:
    """Whether a URL leads every device to itself."""
    host = urlsplit(url).hostname or ""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def remember_url(settings: ServerSettings, url: str) -> None:
    """Keep the URL that the server tells others, for invitations."""
    write_private(settings.authority_folder / LAST_URL, f"{url}\n".encode())


def last_url(settings: ServerSettings) -> str:
    """Where the server was reached last, or will be."""
    file: Path = settings.authority_folder / LAST_URL
    if file.is_file():
        return file.read_text(encoding="utf-8").strip()
    return url_of([*lan_addresses(), LOOPBACK][0], PORT, secure=True)


def url_for_others(asked: str, settings: ServerSettings) -> str:
    """The URL for another device, where somebody asked by the URL `asked`.

    Raises Problem 409 where it would lead that device to itself. Plain HTTP is spoken to a reverse
    proxy or in a test, on this machine: `asked` has to do.
    """
    if not reaches_nobody(asked):
        return asked
    told = last_url(settings)
    if not reaches_nobody(told):
        return told
    if settings.secure_cookie:
        raise Problem(409, ALONE)
    return asked
