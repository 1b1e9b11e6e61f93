"""Where the server listens: this machine, and its local networks."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from elfslam.base.errors import InputError

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
    local = (address for address in found if is_local(address) and not _is_loopback(address))
    return list(dict.fromkeys(local))


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
        raise InputError(f"--host {host}: is no address ({error.strerror}); give one") from error
    public = [address for address in found if not is_local(address)]
    if public and not allow_public:
        raise InputError(
            f"--host {host}: {public[0]} may be reached from outside the local network; choose a "
            "local address, or say --allow-public"
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
                    "running already? choose another --port"
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


def _is_loopback(address: str) -> bool:
    return ipaddress.ip_address(address).is_loopback


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
