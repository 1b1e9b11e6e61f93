"""Where the server listens, by which names browsers call it, and where others reach it.

A page of another site can have its own name lead to our address, and its scripts then pass for
ours; so a name has to be one that we know. An address cannot be turned like that: any may be used.
"""

import ipaddress
import re
import socket
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from elfslam.base.errors import InputError
from elfslam.serve.network.authority import write_private
from elfslam.serve.problems import Problem
from elfslam.serve.settings import PORT, ServerSettings

LOOPBACK = "127.0.0.1"
PROBES = ("198.51.100.1", "192.168.255.255", "10.255.255.255", "172.31.255.255")
"""A route to one of these shows our own address; nothing is sent there. The first is beyond any
local network: its route is that of the network which phones use too, and not that of a tunnel."""
LOCAL_NETWORKS = tuple(
    map(
        ipaddress.ip_network,
        (
            "127.0.0.0/8",
            "10.0.0.0/8",
            "172.16.0.0/12",
            "192.168.0.0/16",
            "169.254.0.0/16",
            "::1/128",
            "fc00::/7",
            "fe80::/10",
        ),
    )
)


def is_local(host: str) -> bool:
    """Whether an address is this machine's or of a local network."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None) or address
    return any(mapped in network for network in LOCAL_NETWORKS)


def lan_addresses() -> list[str]:
    """This machine's IPv4 addresses in local networks, that of the default route first."""
    found = [address for address in map(_own_address_towards, PROBES) if address]
    try:
        known = socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)
        found += [str(info[4][0]) for info in known]
    except OSError:
        pass
    local = [address for address in found if is_local(address)]
    return list(dict.fromkeys(each for each in local if not ipaddress.ip_address(each).is_loopback))


def server_names(addresses: Sequence[str]) -> list[str]:
    """What the certificate of a server at these addresses names."""
    host = socket.gethostname().partition(".")[0]
    names = [*addresses, LOOPBACK, "localhost"]
    if host.isascii() and host.replace("-", "").isalnum():
        names += [host, f"{host}.local"]
    return list(dict.fromkeys(names))


def checked_hosts(host: str | None, *, allow_public: bool) -> list[str]:
    """The addresses to listen at: by default the local network's and loopback.

    Raises InputError for one that others than the local network reach, unless that is allowed.
    """
    if host is None:
        return [*lan_addresses(), LOOPBACK]
    try:
        found = [str(info[4][0]) for info in socket.getaddrinfo(host, None)]
    except OSError as error:
        raise InputError(
            f"{host}: is no address ({error.strerror}); give one", argument="host"
        ) from error
    public = [address for address in found if not is_local(address)]
    if public and not allow_public:
        raise InputError(
            f"{host}: {public[0]} may be reached from outside the local network; choose a local "
            "address, or allow public ones",
            argument="allow_public",
        )
    return list(dict.fromkeys(found))


@contextmanager
def listening_at(hosts: Sequence[str], port: int) -> Iterator[list[socket.socket]]:
    """Listening sockets at these addresses and one port; 0 chooses one. Raises InputError."""
    with ExitStack() as stack:
        sockets: list[socket.socket] = []
        for host in hosts:
            try:
                sockets.append(stack.enter_context(_listening(host, port)))
            except OSError as error:
                raise InputError(
                    f"{host} port {port}: cannot listen there ({error.strerror}); is a server "
                    "running already? choose another port",
                    argument="port",
                ) from error
            port = sockets[0].getsockname()[1]
        yield sockets


def url_of(host: str, port: int, *, secure: bool) -> str:
    """The address that a browser opens."""
    shown = f"[{host}]" if ":" in host else host
    return f"{'https' if secure else 'http'}://{shown}:{port}/"


def _own_address_towards(other: str) -> str | None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((other, 9))
        except OSError:
            return None
        return str(probe.getsockname()[0])


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    opened = socket.socket(family, socket.SOCK_STREAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((host, port))
        opened.listen(256)
    except OSError:
        opened.close()
        raise
    return opened


NAME = re.compile(r"[a-z0-9]([a-z0-9.-]{0,251}[a-z0-9])?")
HOST = re.compile(r"(\[(?P<address>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(:[0-9]{1,5})?")
"""Of a header: an address there has no zone, which means something on one machine alone."""


def checked_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names that somebody gave, as browsers send them. Raises InputError."""
    for name in names:
        if not NAME.fullmatch(name.lower()):
            raise InputError(
                f"{name!r:.60}: is no name of a host; wanted such as floors.example.org, without "
                "scheme and port",
                argument="name",
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


LAST_URL = "url"
ALONE = (
    "no other device reaches this server: this machine is in no local network; connect it to the "
    "phone's network and start again, or say --address"
)


def told_url(address: str, port: int, *, secure: bool) -> str:
    """The URL of where others reach it: a host, or a whole URL. Raises InputError."""
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
            f"{address!r:.60}: wanted a host or https://HOST/, such as 192.168.1.7",
            argument="address",
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
