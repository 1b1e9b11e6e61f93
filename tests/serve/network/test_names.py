"""Which names are names, and whose a Host header is."""

from __future__ import annotations

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.network.names import checked_names, host_of, is_known


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
    with pytest.raises(InputError, match=r"--name .*wanted such as floors\.example\.org"):
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
