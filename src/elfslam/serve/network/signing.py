"""The key that signs what phones keep: ECDSA on P-256, made once, in the authority's folder."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import os
import secrets
from pathlib import Path

from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature

from elfslam.base.errors import InputError, StoreError
from elfslam.base.text_files import read_bytes
from elfslam.serve.store.blobs import link_or_copy

SIGNING_KEY, CURVE = "signing.key", ec.SECP256R1()
MOST_KEY_BYTES = 100_000
NUMBER_BYTES = 32
"""Of r and of s, which a signature consists of where browsers check it."""


def signing_key(folder: Path) -> ec.EllipticCurvePrivateKey:
    """The key in an authority's folder, made where there is none. Raises StoreError."""
    if not os.path.lexists(folder / SIGNING_KEY):
        _make(folder / SIGNING_KEY)
    return read_key(folder)


def read_key(folder: Path) -> ec.EllipticCurvePrivateKey:
    """The key that lies in an authority's folder. Raises StoreError, also for what is no file."""
    file = folder / SIGNING_KEY
    try:
        pem = read_bytes(file, MOST_KEY_BYTES)
        key = serialization.load_pem_private_key(pem, password=None)
        if not isinstance(key, ec.EllipticCurvePrivateKey) or key.curve.name != CURVE.name:
            raise ValueError("it is of another kind")
    except (InputError, ValueError, TypeError) as error:
        raise StoreError(
            f"{file}: is no key ({type(error).__name__}); restore it from a backup, or pair all "
            "phones again with --new-key"
        ) from error
    return key


def spki_of(key: ec.EllipticCurvePrivateKey) -> bytes:
    """The public key as a SubjectPublicKeyInfo (DER), as browsers import it."""
    encoding, form = serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    return key.public_key().public_bytes(encoding, form)


def fingerprint(key: ec.EllipticCurvePrivateKey) -> str:
    """The SHA-256 of the public key as an address carries it: base64url without padding."""
    digest = hashlib.sha256(spki_of(key)).digest()
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode()


def sign(key: ec.EllipticCurvePrivateKey, content: bytes) -> bytes:
    """The signature of some bytes, r and s one after the other, as WebCrypto checks it."""
    numbers = decode_dss_signature(key.sign(content, ec.ECDSA(hashes.SHA256())))
    return b"".join(number.to_bytes(NUMBER_BYTES, "big") for number in numbers)


def pairing_fragment(secret: str, folder: Path, *, name: str = "token") -> str:
    """What an address ends in that pairs a phone: a token or code, and the key it is to trust."""
    return f"#{name}={secret}&key={fingerprint(signing_key(folder))}"


def _make(file: Path) -> None:
    """Write a new key for its owner's eyes; of two that do so at once, the first counts."""
    made = ec.generate_private_key(CURVE).private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    partial = file.with_name(f"{secrets.token_hex(8)}.partial")
    descriptor = os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(made)
            stream.flush()
            os.fsync(stream.fileno())
        with contextlib.suppress(FileExistsError):
            link_or_copy(partial, file)
    finally:
        partial.unlink()
