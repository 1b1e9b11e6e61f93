"""Where other devices reach the server: never at an address that is every device's own."""

from __future__ import annotations

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.network import reach
from elfslam.serve.network.names import name_in
from elfslam.serve.network.reach import (
    last_url,
    reaches_nobody,
    remember_url,
    told_url,
    url_for_others,
)
from elfslam.serve.problems import Problem
from elfslam.serve.settings import ServerSettings


@pytest.mark.parametrize(
    ("address", "wanted"),
    [
        ("192.168.1.7", "https://192.168.1.7:8443/"),
        ("fd12::1", "https://[fd12::1]:8443/"),
        ("maps.example.org", "https://maps.example.org:8443/"),
        ("https://maps.example.org", "https://maps.example.org/"),
        ("http://proxy:81/", "http://proxy:81/"),
    ],
)
def test_an_address_becomes_a_url(address: str, wanted: str) -> None:
    assert told_url(address, 8443, secure=True) == wanted


@pytest.mark.parametrize(
    "address",
    [
        "",
        "ftp://host/",
        "https://",
        "https://host/?a",
        "host#a",
        "javascript:alert(1)",
        "https://[::1",
        "host/path",
        "a b",
        "https://me:word@host",
        "https://host:0/",
        "fe80::1%eth0",
    ],
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="--address"):
        told_url(address, 8443, secure=True)
    name_in(address)


@pytest.mark.parametrize(
    ("url", "nobody"),
    [
        ("https://127.0.0.1:8443/", True),
        ("https://[::1]:8443/", True),
        ("http://localhost/", True),
        ("https://192.168.1.7/", False),
        ("https://maps.example.org/", False),
    ],
)
def test_who_is_led_to_itself(url: str, nobody: bool) -> None:
    assert reaches_nobody(url) is nobody


def test_the_address_by_which_somebody_asked_is_good_for_others(settings: ServerSettings) -> None:
    remember_url(settings, "https://10.0.0.7:8443/")
    assert last_url(settings) == "https://10.0.0.7:8443/"
    assert url_for_others("https://10.0.0.9:8443/", settings) == "https://10.0.0.9:8443/"
    assert url_for_others("https://localhost:8443/", settings) == "https://10.0.0.7:8443/"


def test_a_machine_without_a_network_says_so(
    settings: ServerSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dataclasses import replace

    monkeypatch.setattr(reach, "lan_addresses", list)
    own = "http://127.0.0.1:8443/"
    assert url_for_others(own, settings) == own, "spoken to a proxy on this machine"
    with pytest.raises(Problem, match="409"):
        url_for_others(own, replace(settings, secure_cookie=True))


@pytest.mark.parametrize(
    ("address", "names"),
    [
        (None, ()),
        ("192.168.1.7", ()),
        ("maps.example.org", ("maps.example.org",)),
        ("https://maps.example.org:81/", ("maps.example.org",)),
    ],
)
def test_a_name_in_an_address_is_answered_to(address: str | None, names: tuple[str, ...]) -> None:
    assert name_in(address) == names
