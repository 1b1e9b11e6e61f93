"""The server's own certificate authority, and the certificate that browsers are shown.

A phone that installs `authority.pem` trusts what this authority signs, so its key is kept where
only the owner of the data folder reads it. Certificates last 825 days at most, which iOS asks for.
"""

from __future__ import annotations

import ipaddress
import os
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import trustme
from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization

from elfslam.base.errors import InputError, StoreError
from elfslam.base.text_files import read_bytes
from elfslam.data.atomic_files import replaced_file

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
