"""What a real server allows one address, and all."""

from __future__ import annotations

import resource
import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from elfslam.base.errors import InputError
from elfslam.serve.network.serving import allow_open_files

Start = Callable[..., Any]


def connected(url: str) -> socket.socket:
    parts = urlsplit(url)
    return socket.create_connection((str(parts.hostname), parts.port or 0), timeout=20)


@pytest.mark.parametrize(("limits", "after"), [((64, 700), 600), ((650, 700), 650)])
def test_as_many_files_as_wanted_may_be_open(
    monkeypatch: pytest.MonkeyPatch, limits: tuple[int, int], after: int
) -> None:
    told = [limits]
    monkeypatch.setattr(resource, "getrlimit", lambda _: told[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, wanted: told.append(wanted))
    allow_open_files(600)
    assert told[-1] == (after, 700)


def test_too_few_open_files_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (12, 12))
    with pytest.raises(InputError, match=r"12 files at once, wanted 600 .* ulimit -n 600"):
        allow_open_files(600)


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
