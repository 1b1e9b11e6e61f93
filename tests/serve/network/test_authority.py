"""The server's own authority: its certificates are what phones ask for, and are renewed."""

import base64
import hashlib
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature
from cryptography.x509.oid import ExtendedKeyUsageOID

from elfslam.base.errors import StoreError
from elfslam.serve.network.authority import (
    SIGNING_KEY,
    fingerprint,
    fingerprint_of,
    named_in,
    open_authority,
    pairing_fragment,
    server_certificate,
    sign,
    signing_key,
    spki_of,
)

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


def test_the_fingerprint_is_the_digest_of_the_certificate(tmp_path: Path) -> None:
    server_certificate(tmp_path, NAMES, NOW)
    body = (tmp_path / "authority.pem").read_text().split("-----")[2]
    digest = hashlib.sha256(base64.b64decode(body)).hexdigest().upper()
    pairs = fingerprint_of(tmp_path / "authority.pem").split(":")
    assert ("".join(pairs), len(pairs)) == (digest, 32)


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


def test_a_clock_that_was_set_back_gets_a_certificate_of_its_time(tmp_path: Path) -> None:
    server_certificate(tmp_path, NAMES, NOW)
    earlier = NOW - timedelta(days=1000)
    made = read(server_certificate(tmp_path, NAMES, earlier).certificate)
    assert made.not_valid_before_utc < earlier < made.not_valid_after_utc


@pytest.mark.parametrize("content", [b"", b"no key", None])
def test_a_key_that_does_not_fit_is_replaced(tmp_path: Path, content: bytes | None) -> None:
    kept = server_certificate(tmp_path, NAMES, NOW)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    another = server_certificate(elsewhere, NAMES, NOW).key.read_bytes()
    kept.key.write_bytes(another if content is None else content)
    again = server_certificate(tmp_path, NAMES, NOW)
    key = serialization.load_pem_private_key(again.key.read_bytes(), password=None)
    assert key.public_key() == read(again.certificate).public_key()


def test_a_broken_certificate_is_replaced(tmp_path: Path) -> None:
    kept = server_certificate(tmp_path, NAMES, NOW)
    kept.certificate.write_text("no certificate")
    assert named_in(read(server_certificate(tmp_path, NAMES, NOW).certificate)) == set(NAMES)


def test_a_broken_authority_is_said(tmp_path: Path) -> None:
    open_authority(tmp_path)
    (tmp_path / "authority.key").unlink()
    with pytest.raises(StoreError, match=r"delete both authority\.pem and authority\.key"):
        open_authority(tmp_path)


def test_a_key_is_made_once_and_for_its_owner_alone(tmp_path: Path) -> None:
    first = spki_of(signing_key(tmp_path))
    assert spki_of(signing_key(tmp_path)) == first
    assert [file.name for file in tmp_path.iterdir()] == [SIGNING_KEY]
    assert (tmp_path / SIGNING_KEY).stat().st_mode & 0o777 == 0o600


def test_an_address_names_the_digest_of_the_key(tmp_path: Path) -> None:
    key = signing_key(tmp_path)
    told = fingerprint(key)
    assert base64.urlsafe_b64decode(told + "=") == hashlib.sha256(spki_of(key)).digest()
    assert pairing_fragment("abc", tmp_path) == f"#token=abc&key={told}"


def test_a_signature_holds_for_these_bytes_alone(tmp_path: Path) -> None:
    signature = sign(signing_key(tmp_path), b"a map")
    assert len(signature) == 64
    numbers = (int.from_bytes(half, "big") for half in (signature[:32], signature[32:]))
    public = serialization.load_der_public_key(spki_of(signing_key(tmp_path)))
    assert isinstance(public, ec.EllipticCurvePublicKey)
    told = encode_dss_signature(*numbers)
    public.verify(told, b"a map", ec.ECDSA(hashes.SHA256()))
    with pytest.raises(InvalidSignature):
        public.verify(told, b"a mop", ec.ECDSA(hashes.SHA256()))


@pytest.mark.parametrize("content", [b"", b"no key", None])
def test_a_damaged_key_is_refused(tmp_path: Path, content: bytes | None) -> None:
    other = ec.generate_private_key(ec.SECP384R1()).private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    (tmp_path / SIGNING_KEY).write_bytes(other if content is None else content)
    with pytest.raises(StoreError, match="is no key"):
        signing_key(tmp_path)
