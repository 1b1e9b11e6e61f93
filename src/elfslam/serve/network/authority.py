"""The server's own certificate authority, the certificate that browsers see, and the signing key.

A phone that installs `authority.pem` trusts what this authority signs, so its key is kept where
only the owner of the data folder reads it. Certificates last 825 days at most, which iOS asks for.
What phones keep is signed by ECDSA on P-256 with a key that is made once.
"""

import base64
import contextlib
import hashlib
import ipaddress
import os
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import trustme
from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature

from elfslam.base.errors import InputError, StoreError
from elfslam.base.text_files import read_bytes
from elfslam.data.atomic_files import replaced_file
from elfslam.serve.store.blobs import link_or_copy

AUTHORITY, AUTHORITY_KEY = "authority.pem", "authority.key"
SERVER, SERVER_KEY = "server.pem", "server.key"
LONGEST = timedelta(days=825)
RENEWED_BEFORE = timedelta(days=30)
MOST_PEM_BYTES = 100_000
SLACK = timedelta(days=1)
"""Phones whose clock is late still accept a new certificate."""


@dataclass(frozen=True)
class Certificate:
    """Where the server's certificate and its key lie."""

    certificate: Path
    key: Path


def server_certificate(folder: Path, names: Sequence[str], now_utc: datetime) -> Certificate:
    """A certificate for these addresses and names, kept until it runs out or they change.

    Raises StoreError where the authority cannot be read.
    """
    kept = Certificate(folder / SERVER, folder / SERVER_KEY)
    if not _serves(kept, names, now_utc):
        issued = open_authority(folder).issue_cert(
            *names,
            organization_name="elfslam",
            organization_unit_name="server",
            not_before=now_utc - SLACK,
            not_after=now_utc - SLACK + LONGEST,
        )
        chain = b"".join(blob.bytes() for blob in issued.cert_chain_pems)
        write_private(kept.key, issued.private_key_pem.bytes())
        write_private(kept.certificate, chain)
    return kept


def open_authority(folder: Path) -> trustme.CA:
    """The authority of a folder, made where there is none. Raises StoreError."""
    certificate, key = folder / AUTHORITY, folder / AUTHORITY_KEY
    if not is_there(folder):
        unit = f"authority of {socket.gethostname()}"[:60]
        made = trustme.CA(organization_name="elfslam", organization_unit_name=unit, path_length=0)
        write_private(key, made.private_key_pem.bytes())
        write_private(certificate, made.cert_pem.bytes())
    try:
        pems = [read_bytes(file, MOST_PEM_BYTES) for file in (certificate, key)]
        fits = x509.load_pem_x509_certificate(pems[0]).public_key()
        if serialization.load_pem_private_key(pems[1], None).public_key() != fits:
            raise ValueError("its key is another one's")
        return trustme.CA.from_pem(*pems)
    except (InputError, ValueError, TypeError, UnsupportedAlgorithm) as error:
        said = str(error).partition(". ")[0]
        raise StoreError(
            f"{folder}: the authority cannot be read ({said}); delete both {AUTHORITY} and "
            f"{AUTHORITY_KEY} for a new one, which phones then install again"
        ) from error


def check_authority(folder: Path) -> None:
    """Raise StoreError where an authority is there and cannot be read."""
    if is_there(folder):
        open_authority(folder)


def is_there(folder: Path) -> bool:
    """Whether a folder has an authority, or a part of one."""
    return any(os.path.lexists(folder / name) for name in (AUTHORITY, AUTHORITY_KEY))


def fingerprint_of(file: Path) -> str:
    """The SHA-256 of a certificate as phones show it: pairs of digits with colons."""
    certificate = x509.load_pem_x509_certificate(file.read_bytes())
    return certificate.fingerprint(hashes.SHA256()).hex(":").upper()


def named_in(certificate: x509.Certificate) -> set[str]:
    """The addresses and names that a certificate is for."""
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    addresses = names.get_values_for_type(x509.IPAddress)
    return {*names.get_values_for_type(x509.DNSName), *map(str, addresses)}


def _serves(kept: Certificate, names: Sequence[str], now_utc: datetime) -> bool:
    if not (kept.certificate.is_file() and kept.key.is_file()):
        return False
    try:
        certificate = x509.load_pem_x509_certificate(kept.certificate.read_bytes())
        key = serialization.load_pem_private_key(kept.key.read_bytes(), password=None)
        lasts = certificate.not_valid_after_utc > now_utc + RENEWED_BEFORE
        begun = certificate.not_valid_before_utc <= now_utc
        fits = key.public_key() == certificate.public_key()
        return lasts and begun and fits and named_in(certificate) == set(map(_canonical, names))
    except (ValueError, TypeError, UnsupportedAlgorithm, x509.ExtensionNotFound):
        return False


def _canonical(name: str) -> str:
    try:
        return str(ipaddress.ip_address(name))
    except ValueError:
        return name


def utc_now() -> datetime:
    """The time now, in whole seconds as certificates have it."""
    return datetime.now(UTC).replace(microsecond=0)


def write_private(file: Path, data: bytes) -> None:
    """Write a file that only its owner reads."""
    with replaced_file(file) as partial:
        partial.touch(mode=0o600)
        partial.write_bytes(data)


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
            "phones again with a new one",
            argument="new_key",
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
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
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
