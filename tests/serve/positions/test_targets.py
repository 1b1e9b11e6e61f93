"""Webhooks lead to the Internet alone, whatever a URL or a name server says."""

from __future__ import annotations

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.positions.targets import address_of, is_public, target_of

PUBLIC = ["93.184.216.34", "2606:2800:220:1:248:1893:25c8:1946", "::ffff:93.184.216.34"]
HIDDEN = [
    "127.0.0.1", "127.1.2.3", "0.0.0.0", "10.0.0.1", "172.16.0.1", "192.168.1.1", "169.254.169.254",
    "100.64.0.1", "224.0.0.1", "240.0.0.1", "255.255.255.255", "::1", "::", "fe80::1", "fc00::1",
    "ff02::1", "::ffff:127.0.0.1", "::ffff:10.0.0.1", "64:ff9b::7f00:1", "64:ff9b::a00:1",
    "2002:7f00:1::", "2002:a00:1::", "fe80::1%eth0", "no address",
]  # fmt: skip


@pytest.mark.parametrize("address", PUBLIC)
def test_the_internet_is_public(address: str) -> None:
    assert is_public(address)


@pytest.mark.parametrize("address", HIDDEN)
def test_this_machine_and_its_networks_are_not(address: str) -> None:
    assert not is_public(address)


def test_a_url_comes_apart() -> None:
    target = target_of("https://hooks.example.org:8443/a/b?c=d")
    assert (target.is_secure, target.host, target.port) == (True, "hooks.example.org", 8443)
    assert (target.path, target.authority) == ("/a/b?c=d", "hooks.example.org:8443")
    assert target_of("http://[2606:2800::1]").authority == "[2606:2800::1]"
    assert (target_of("http://h").port, target_of("http://h").path) == (80, "/")


@pytest.mark.parametrize(
    "url",
    [
        "",
        "hooks.example.org",
        "//hooks.example.org/",
        "file:///etc/passwd",
        "gopher://h/",
        "http://",
        "http://user@h/",
        "http://user:word@h/",
        "http://h/#part",
        "http://h:0/",
        "http://h:99999/",
        "http://h/a b",
        "http://h/\r\nX: y",
        "http://[::1",
        "http://hö/",
        "http://[fe80::1%25eth0]/",
    ],
)
def test_what_is_no_plain_url_is_refused(url: str) -> None:
    with pytest.raises(InputError, match="wanted http"):
        target_of(url)


def test_one_hidden_address_among_public_ones_is_refused() -> None:
    target = target_of("http://h/")
    mixed = ["93.184.216.34", "127.0.0.1"]
    with pytest.raises(InputError, match=r"leads to 127\.0\.0\.1"):
        address_of(target, allow_local=False, resolve=lambda *_: mixed)
    assert address_of(target, allow_local=True, resolve=lambda *_: mixed) == mixed[0]
    assert address_of(target, allow_local=False, resolve=lambda *_: mixed[:1]) == mixed[0]


def test_numbers_are_addresses_whatever_their_form() -> None:
    for host in ("2130706433", "0x7f000001", "0177.0.0.1", "127.1", "localhost"):
        with pytest.raises(InputError):
            address_of(target_of(f"http://{host}/"), allow_local=False)


def test_a_name_that_leads_nowhere_is_said() -> None:
    def nothing(_host: str, _port: int) -> list[str]:
        raise OSError(8, "Name or service not known")

    with pytest.raises(InputError, match=r"is not found \(Name or service not known\)"):
        address_of(target_of("http://h/"), allow_local=True, resolve=nothing)
    with pytest.raises(InputError, match="leads to nowhere"):
        address_of(target_of("http://h/"), allow_local=True, resolve=lambda *_: [])
