"""The signature is HMAC-SHA256 of the time and the body, as any receiver computes it."""

from __future__ import annotations

from elfslam.serve.positions.signature import SIGNATURE, TIMESTAMP, digest, signed_headers


def test_it_is_what_openssl_computes() -> None:
    # printf '1700000000.{"a":1}' | openssl dgst -sha256 -hmac key
    wanted = "a438e398bfafc57e4396bb7fc2304422f0f768e965d073ca313cb52e22e6ad03"
    headers = signed_headers("key", 1_700_000_000, b'{"a":1}')
    assert headers == {TIMESTAMP: "1700000000", SIGNATURE: f"sha256={wanted}"}


def test_time_body_and_secret_all_count() -> None:
    found = {
        digest(secret, time_s, body)
        for secret in ("one", "two")
        for time_s in (1, 11)
        for body in (b"", b"1.", b".1")
    }
    assert len(found) == 12
