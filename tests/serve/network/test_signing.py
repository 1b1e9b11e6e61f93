"""The signing key: made once, closed to others, and what it signs can be checked."""

from __future__ import annotations

import base64
import hashlib
from pathlib import Path

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature

from elfslam.base.errors import StoreError
from elfslam.serve.network.signing import (
    SIGNING_KEY,
    fingerprint,
    pairing_fragment,
    sign,
    signing_key,
    spki_of,
)


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
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    (tmp_path / SIGNING_KEY).write_bytes(other if content is None else content)
    with pytest.raises(StoreError, match="is no key"):
        signing_key(tmp_path)
