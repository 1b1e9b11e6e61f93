"""What a real server allows one address, and all."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import httpx

Start = Callable[..., Any]


def connected(url: str) -> socket.socket:
    parts = urlsplit(url)
    return socket.create_connection((str(parts.hostname), parts.port or 0), timeout=20)


def test_one_address_has_a_share(start_server: Start) -> None:
    server = start_server(speaks="https", address_connections=2)
    with connected(server.url) as first, connected(server.url), connected(server.url):
        assert first.recv(1) == b""


def test_behind_a_proxy_all_come_from_one_address(start_server: Start) -> None:
    server = start_server(address_connections=2, connections=3)
    with connected(server.url) as first, connected(server.url), connected(server.url):
        first.settimeout(20)
        assert httpx.get(server.url + "api/version").is_success
        assert first.recv(1) == b""
