"""Where a webhook may lead: http(s) to public addresses, against server-side request forgery.

A name is resolved anew for each delivery, and the connection is made to the very address that was
checked: a name that leads elsewhere a moment later gains nothing.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

from elfslam.base.errors import InputError

PORTS = {"http": 80, "https": 443}
TRANSLATED = ipaddress.ip_network("64:ff9b::/96")
"""NAT64: the last 32 bits are an IPv4 address."""
IpAddress = ipaddress.IPv4Address | ipaddress.IPv6Address
Resolve = Callable[[str, int], Sequence[str]]


@dataclass(frozen=True)
class Target:
    """A URL that positions are posted to, in parts. `path` has the query."""

    url: str
    is_secure: bool
    host: str
    port: int
    path: str

    @property
    def authority(self) -> str:
        """Host and port as the Host header has them."""
        shown = f"[{self.host}]" if ":" in self.host else self.host
        usual = PORTS["https" if self.is_secure else "http"]
        return shown if self.port == usual else f"{shown}:{self.port}"


def target_of(url: str) -> Target:
    """The parts of a URL. Raises InputError for what is no plain http(s) URL."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
    except ValueError:
        parts, host, port = urlsplit(""), "", None
    printable = url.isascii() and url.isprintable() and " " not in url
    good = parts.scheme in PORTS and host and printable and "%" not in host and port != 0
    if not good or parts.username is not None or parts.password is not None or parts.fragment:
        raise InputError(
            f"webhook {url!r:.80}: wanted http(s)://HOST[:PORT]/PATH in ASCII, without a user or a "
            "fragment; such as https://example.org/positions"
        )
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return Target(url, parts.scheme == "https", host, port or PORTS[parts.scheme], path)


def resolved(host: str, port: int) -> Sequence[str]:
    """The addresses of a host, in the order in which they are to be tried. Raises OSError."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(info[4][0]) for info in found))


def address_of(target: Target, *, allow_local: bool, resolve: Resolve | None = None) -> str:
    """The address to connect to. Raises InputError where one of its host's is not public."""
    try:
        found = (resolve or resolved)(target.host, target.port)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or "no such name"
        raise InputError(f"webhook {target.host:.60}: is not found ({why}); check it") from error
    hidden = [address for address in found if not is_public(address)]
    if not found or (hidden and not allow_local):
        leads = hidden[0] if hidden else "nowhere"
        raise InputError(
            f"webhook {target.host:.60}: leads to {leads}, which is not public; choose another, or "
            "have the server started with --local-webhooks"
        )
    return found[0]


def is_public(address: str) -> bool:
    """Whether an address is one of the Internet: neither this machine's, nor a local network's."""
    try:
        return all(_is_global(each) for each in _meant(ipaddress.ip_address(address)))
    except ValueError:
        return False


def _is_global(address: IpAddress) -> bool:
    return address.is_global and not (address.is_multicast or address.is_reserved)


def _meant(address: IpAddress) -> list[IpAddress]:
    """An address, and that of IPv4 which is written in it."""
    if isinstance(address, ipaddress.IPv4Address):
        return [address]
    if address.ipv4_mapped is not None:
        return [address.ipv4_mapped]
    if address in TRANSLATED:
        return [ipaddress.IPv4Address(int(address) & 0xFFFF_FFFF)]
    inside = [address.sixtofour, *(address.teredo or ())]
    return [address, *(each for each in inside if each is not None)]
