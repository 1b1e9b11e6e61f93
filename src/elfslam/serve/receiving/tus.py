"""The headers of tus 1.0, the open protocol for resumable uploads (https://tus.io/protocols).

Here is what they mean; `uploads.py` has the routes, `appending.py` the bytes.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from dataclasses import dataclass
from datetime import datetime
from email.utils import format_datetime
from typing import Any

from elfslam.serve.people.guards import TUS_VERSION
from elfslam.serve.problems import WRONG_CHECKSUM, Problem

EXTENSIONS = "creation,creation-with-upload,creation-defer-length,termination,checksum,expiration"
ALGORITHMS = ("sha256", "sha1")
CONTENT_TYPE = "application/offset+octet-stream"
LONGEST_METADATA = 4096


@dataclass(frozen=True)
class Checksum:
    """What the body of a request must hash to."""

    algorithm: str
    digest: bytes

    def hasher(self) -> Any:
        """A new hash of that algorithm."""
        return hashlib.new(self.algorithm)


def check_version(given: str) -> None:
    """Raise Problem 412 for a client of another version of the protocol."""
    if given != TUS_VERSION:
        raise Problem(
            412,
            f"Tus-Resumable is {given!r:.30}; wanted {TUS_VERSION}",
            {"Tus-Version": TUS_VERSION},
        )


def check_content_type(given: str) -> None:
    """Raise Problem 415 where a body is not said to be a piece of a file."""
    if given.partition(";")[0].strip().lower() != CONTENT_TYPE:
        raise Problem(415, f"Content-Type is {given!r:.60}; wanted {CONTENT_TYPE}")


def parse_metadata(text: str) -> dict[str, str]:
    """Upload-Metadata as names and texts. Raises Problem 400."""
    if len(text) > LONGEST_METADATA:
        raise Problem(400, f"Upload-Metadata is longer than {LONGEST_METADATA}; send less")
    told: dict[str, str] = {}
    for pair in filter(None, (part.strip() for part in text.split(","))):
        name, _, coded = pair.partition(" ")
        if name in told:
            raise Problem(400, f"Upload-Metadata says {name!r:.40} twice; say it once")
        told[name] = _decoded(name, coded.strip())
    return told


def metadata(told: dict[str, str]) -> str:
    """Names and texts as Upload-Metadata."""
    return ",".join(
        f"{name} {base64.b64encode(text.encode()).decode()}" for name, text in told.items()
    )


def parse_checksum(text: str | None) -> Checksum | None:
    """Upload-Checksum, where it was sent. Raises Problem 400."""
    if text is None:
        return None
    algorithm, _, coded = text.strip().partition(" ")
    if algorithm not in ALGORITHMS:
        known = " and ".join(ALGORITHMS)
        raise Problem(400, f"Upload-Checksum by {algorithm!r:.30}; {known} are known here")
    try:
        digest = base64.b64decode(coded.strip(), validate=True)
    except (binascii.Error, ValueError) as error:
        raise Problem(400, "Upload-Checksum is no Base64; send the digest so") from error
    return Checksum(algorithm, digest)


def wrong_checksum() -> Problem:
    """The refusal of a body that does not hash to what was said."""
    return Problem(WRONG_CHECKSUM, "the piece came changed and was thrown away; send it again")


def http_date(time_utc: datetime) -> str:
    """A time as HTTP headers say it."""
    return format_datetime(time_utc, usegmt=True)


def _decoded(name: str, coded: str) -> str:
    try:
        return base64.b64decode(coded, validate=True).decode("utf-8")
    except (binascii.Error, ValueError) as error:
        raise Problem(
            400, f"Upload-Metadata {name!r:.40} is no Base64 of UTF-8; repair it"
        ) from error
