"""Where the server listens: what is this machine's, and what is local."""

from __future__ import annotations

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.network.addresses import (
    checked_names,
    host_of,
    is_known,
    is_local,
    last_url,
    name_in,
    reaches_nobody,
    remember_url,
    told_url,
    url_for_others,
)
from elfslam.serve.problems import Problem
from elfslam.serve.settings import ServerSettings


@pytest.mark.parametrize(
    ("host", "local"),
    [
        ("127.0.0.1", True),
        ("192.168.1.20", True),
        ("10.0.0.3", True),
        ("172.31.255.1", True),
        ("172.32.0.1", False),
        ("8.8.8.8", False),
        ("100.64.0.1", False),
        ("::1", True),
        ("fe80::1%eth0", True),
        ("fd12::1", True),
        ("2001:db8::1", False),
        ("::ffff:192.168.1.20", True),
        ("::ffff:8.8.8.8", False),
        ("testclient", False),
        ("", False),
    ],
)
def test_who_is_local(host: str, local: bool) -> None:
    assert is_local(host) is local


def test_names_are_taken_as_browsers_send_them() -> None:
    assert checked_names(["Floors.Example.org", "xn--bro-5na.example"]) == (
        "floors.example.org",
        "xn--bro-5na.example",
    )
    assert checked_names([]) == ()


@pytest.mark.parametrize(
    "name",
    ["", "https://floors.example.org", "floors.example.org:8443", "a b", "büro.example", ".a", "*"],
)
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(
        InputError, match=r"is no name of a host; wanted such as floors\.example\.org"
    ):
        checked_names([name])


@pytest.mark.parametrize(
    ("header", "host"),
    [
        ("floors.example.org", "floors.example.org"),
        ("Floors.example.ORG:8443", "floors.example.org"),
        ("127.0.0.1:80", "127.0.0.1"),
        ("[::1]:8443", "::1"),
        ("[::1]", "::1"),
        ("", ""),
        ("[fe80::1%25eth0]", ""),
        ("[fe80::1%eth0]:8443", ""),
        ("[::1", ""),
        ("127.0.0.1:1:1", ""),
        ("127.0.0.1:port", ""),
        ("127.0.0.1 ", ""),
    ],
)
def test_the_host_of_a_header(header: str, host: str) -> None:
    assert host_of(header) == host


def test_addresses_are_known_and_names_have_to_be_given() -> None:
    names = {"localhost"}
    assert all(is_known(host, names) for host in ("localhost", "8.8.8.8", "2001:db8::1"))
    assert not any(is_known(host, names) for host in ("", "evil.example", "0x7f.1", "127.1"))


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
    with pytest.raises(InputError, match="wanted a host or https"):
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

    monkeypatch.setattr("elfslam.serve.network.addresses.lan_addresses", list)
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
