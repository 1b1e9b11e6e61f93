"""By which names browsers may call this server.

A page of another site can have its own name lead to our address, and its scripts then pass for
ours; so a name has to be one that we know. An address cannot be turned like that: any may be used.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Collection, Sequence
from urllib.parse import urlsplit

from elfslam.base.errors import InputError

NAME = re.compile(r"[a-z0-9]([a-z0-9.-]{0,251}[a-z0-9])?")
HOST = re.compile(r"(\[(?P<address>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(:[0-9]{1,5})?")
"""Of a header: an address there has no zone, which means something on one machine alone."""


def checked_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names that somebody gave, as browsers send them. Raises InputError."""
    for name in names:
        if not NAME.fullmatch(name.lower()):
            raise InputError(
                f"--name {name!r:.60}: is no name of a host; wanted such as floors.example.org, "
                "without scheme and port"
            )
    return tuple(name.lower() for name in names)


def name_in(address: str | None) -> tuple[str, ...]:
    """The name of a host in an address or a URL that somebody gave; none in a number."""
    try:
        host = urlsplit(address if "://" in address else f"//{address}").hostname if address else ""
    except ValueError:  # what is wrong with it, `told_url` says
        host = ""
    return () if not host or is_known(host, ()) else (host,)


def host_of(header: str) -> str:
    """The name or the address in a Host header, without its port; nothing where it is none."""
    found = HOST.fullmatch(header.lower())
    return (found["address"] or found["name"]) if found else ""


def is_known(host: str, names: Collection[str]) -> bool:
    """Whether a host is an address, or one of these names."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return host in names
    return True
