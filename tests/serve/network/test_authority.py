"""The server's own authority: its certificates are what phones ask for, and are renewed."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from elfslam.base.errors import StoreError
from elfslam.serve.network.authority import named_in, open_authority, server_certificate

NOW = datetime(2026, 5, 1, tzinfo=UTC)
NAMES = ["192.168.1.7", "127.0.0.1", "localhost", "hut.local"]


def read(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_a_certificate_as_phones_want_it(tmp_path: Path) -> None:
    kept = server_certificate(tmp_path, NAMES, NOW)
    made, authority = read(kept.certificate), read(tmp_path / "authority.pem")
    assert named_in(made) == set(NAMES)
    assert made.not_valid_before_utc < NOW < made.not_valid_after_utc
    assert made.not_valid_after_utc - made.not_valid_before_utc <= timedelta(days=825)
    uses = made.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert ExtendedKeyUsageOID.SERVER_AUTH in uses
    made.verify_directly_issued_by(authority)
    for name in ("authority.key", "authority.pem", "server.key", "server.pem"):
        assert (tmp_path / name).stat().st_mode & 0o077 == 0


def test_it_is_kept_until_addresses_change_or_it_runs_out(tmp_path: Path) -> None:
    first = read(server_certificate(tmp_path, NAMES, NOW).certificate)
    again = read(server_certificate(tmp_path, NAMES[::-1], NOW + timedelta(days=700)).certificate)
    assert again == first
    moved = read(server_certificate(tmp_path, ["10.0.0.1"], NOW).certificate)
    assert named_in(moved) == {"10.0.0.1"}
    late = NOW + timedelta(days=810)
    renewed = read(server_certificate(tmp_path, ["10.0.0.1"], late).certificate)
    assert renewed.not_valid_after_utc > moved.not_valid_after_utc
    renewed.verify_directly_issued_by(read(tmp_path / "authority.pem"))


def test_a_broken_certificate_is_replaced(tmp_path: Path) -> None:
    kept = server_certificate(tmp_path, NAMES, NOW)
    kept.certificate.write_text("no certificate")
    assert named_in(read(server_certificate(tmp_path, NAMES, NOW).certificate)) == set(NAMES)


def test_a_broken_authority_is_said(tmp_path: Path) -> None:
    open_authority(tmp_path)
    (tmp_path / "authority.key").unlink()
    with pytest.raises(StoreError, match=r"delete both authority\.pem and authority\.key"):
        open_authority(tmp_path)
