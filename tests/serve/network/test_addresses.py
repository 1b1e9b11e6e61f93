"""Where the server listens: what is this machine's, and what is local."""

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.network import addresses
from elfslam.serve.problems import Problem
from elfslam.serve.settings import ServerSettings

LOCAL = "127.0.0.1 192.168.1.20 10.0.0.3 172.31.255.1 ::1 fe80::1%eth0 fd12::1 ::ffff:192.168.1.20"
ELSEWHERE = "172.32.0.1 8.8.8.8 100.64.0.1 2001:db8::1 ::ffff:8.8.8.8 testclient"
HOSTS = {
    "floors.example.org": "floors.example.org",
    "Floors.example.ORG:8443": "floors.example.org",
    "127.0.0.1:80": "127.0.0.1",
    "[::1]:8443": "::1",
    "[::1]": "::1",
}
NO_HOSTS = ("", "[fe80::1%25eth0]", "[fe80::1%eth0]:8443", "[::1", "127.0.0.1:1:1", "127.0.0.1 ")
URLS = {
    "192.168.1.7": "https://192.168.1.7:8443/",
    "fd12::1": "https://[fd12::1]:8443/",
    "maps.example.org": "https://maps.example.org:8443/",
    "https://maps.example.org": "https://maps.example.org/",
    "http://proxy:81/": "http://proxy:81/",
}
NO_ADDRESSES = (
    "ftp://host/ https:// https://host/?a host#a javascript:alert(1) https://[::1 host/path"
)
NO_ADDRESSES += " https://me:word@host https://host:0/ fe80::1%eth0"


def test_who_is_local() -> None:
    assert [host for host in LOCAL.split() if not addresses.is_local(host)] == []
    assert [host for host in ["", *ELSEWHERE.split()] if addresses.is_local(host)] == []


def test_names_are_taken_as_browsers_send_them() -> None:
    assert addresses.checked_names(["Floors.Example.org", "xn--bro-5na.example"]) == (
        "floors.example.org",
        "xn--bro-5na.example",
    )
    assert addresses.checked_names([]) == ()


@pytest.mark.parametrize(
    "name",
    ["", "https://floors.example.org", "floors.example.org:8443", "a b", "büro.example", ".a", "*"],
)
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(
        InputError, match=r"is no name of a host; wanted such as floors\.example\.org"
    ):
        addresses.checked_names([name])


def test_the_host_of_a_header() -> None:
    assert {header: addresses.host_of(header) for header in HOSTS} == HOSTS
    assert not any(map(addresses.host_of, (*NO_HOSTS, "127.0.0.1:port")))


def test_addresses_are_known_and_names_have_to_be_given() -> None:
    names = {"localhost"}
    assert all(addresses.is_known(host, names) for host in ("localhost", "8.8.8.8", "2001:db8::1"))
    assert not any(
        addresses.is_known(host, names) for host in ("", "evil.example", "0x7f.1", "127.1")
    )


def test_an_address_becomes_a_url() -> None:
    assert {each: addresses.told_url(each, 8443, secure=True) for each in URLS} == URLS


@pytest.mark.parametrize("address", ["", "a b", *NO_ADDRESSES.split()])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="wanted a host or https"):
        addresses.told_url(address, 8443, secure=True)
    addresses.name_in(address)


def test_who_is_led_to_itself() -> None:
    for url in ("https://127.0.0.1:8443/", "https://[::1]:8443/", "http://localhost/"):
        assert addresses.reaches_nobody(url)
    assert not any(
        map(addresses.reaches_nobody, ("https://192.168.1.7/", "https://maps.example.org/"))
    )


def test_the_address_by_which_somebody_asked_is_good_for_others(settings: ServerSettings) -> None:
    addresses.remember_url(settings, "https://10.0.0.7:8443/")
    assert addresses.last_url(settings) == "https://10.0.0.7:8443/"
    assert addresses.url_for_others("https://10.0.0.9:8443/", settings) == "https://10.0.0.9:8443/"
    assert addresses.url_for_others("https://localhost:8443/", settings) == "https://10.0.0.7:8443/"


def test_a_machine_without_a_network_says_so(
    settings: ServerSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dataclasses import replace

    monkeypatch.setattr("elfslam.serve.network.addresses.lan_addresses", list)
    own = "http://127.0.0.1:8443/"
    assert addresses.url_for_others(own, settings) == own, "spoken to a proxy on this machine"
    with pytest.raises(Problem, match="409"):
        addresses.url_for_others(own, replace(settings, secure_cookie=True))


def test_a_name_in_an_address_is_answered_to() -> None:
    assert addresses.name_in(None) == addresses.name_in("192.168.1.7") == ()
    for address in ("maps.example.org", "https://maps.example.org:81/"):
        assert addresses.name_in(address) == ("maps.example.org",)
