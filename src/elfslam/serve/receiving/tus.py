"""tus 1.0, the open protocol for resumable uploads (https://tus.io/protocols): headers and bytes.

Bytes are put to the end of a file and synced before anybody is told so. Whatever happens, the
file's length is what has come: it is cut by nothing, only a piece with a checksum first lies beside
the file, so that bytes that were not checked never become part of it.
"""

import base64
import binascii
import hashlib
import os
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.types import Receive

from elfslam.serve.people.guards import TUS_VERSION
from elfslam.serve.problems import WRONG_CHECKSUM, Problem, disk_full, is_disk_full
from elfslam.serve.store.blobs import refuse_full_disk

EXTENSIONS = "creation,creation-with-upload,creation-defer-length,termination,checksum,expiration"
ALGORITHMS = ("sha256", "sha1")
CONTENT_TYPE = "application/offset+octet-stream"
LONGEST_METADATA = 4096


@dataclass(frozen=True)
class Checksum:
    """What the body of a request must hash to."""

    algorithm: str
    digest: bytes


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


def _decoded(name: str, coded: str) -> str:
    try:
        return base64.b64decode(coded, validate=True).decode("utf-8")
    except (binascii.Error, ValueError) as error:
        raise Problem(
            400, f"Upload-Metadata {name!r:.40} is no Base64 of UTF-8; repair it"
        ) from error


PIECE = ".piece"
"""Of a piece that waits for its checksum."""
COPY_BYTES = 2**20


@dataclass(frozen=True)
class Quota:
    """How much may be written: at most so much, until only so much is free on the disk."""

    most_bytes: int
    free_bytes: int


async def append(file: Path, receive: Receive, room: Quota, checksum: Checksum | None) -> None:
    """Put a body to the end of a file and sync it.

    Raises Problem: 413 over the most, 507 on a full disk, 400 where the connection was lost, and
    what `receive` raises (what came is kept in all of these, without a checksum), 460.
    """
    if checksum is None:
        await _write_body(file, receive, room, None)
        return
    piece = file.with_name(file.name + PIECE)
    try:
        piece.unlink(missing_ok=True)
        hasher = hashlib.new(checksum.algorithm)
        await _write_body(piece, receive, room, hasher)
        if hasher.digest() != checksum.digest:
            raise Problem(
                WRONG_CHECKSUM, "the piece came changed and was thrown away; send it again"
            )
        await run_in_threadpool(_append_file, file, piece, room)
    finally:
        piece.unlink(missing_ok=True)


async def _write_body(file: Path, receive: Receive, room: Quota, hasher: Any) -> None:
    came = 0
    descriptor = await run_in_threadpool(_open, file)
    try:
        async for chunk in _chunks(receive):
            came += len(chunk)
            if came > room.most_bytes:
                raise Problem(413, f"only {room.most_bytes} bytes more may come here; send less")
            if hasher is not None:
                hasher.update(chunk)
            await run_in_threadpool(_write, descriptor, chunk, room.free_bytes)
        await run_in_threadpool(os.fsync, descriptor)
    except OSError as error:
        raise (disk_full() if is_disk_full(error) else error) from error
    finally:
        os.close(descriptor)


async def _chunks(receive: Receive) -> AsyncIterator[bytes]:
    """The body as it comes. Raises Problem 400 where it ends early."""
    more = True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise Problem(400, "the connection was lost; go on from the offset")
        more = message.get("more_body", False)
        if chunk := message.get("body", b""):
            yield chunk


def _open(file: Path) -> int:
    return os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)


def _write(descriptor: int, chunk: bytes, free_bytes: int) -> None:
    """Write all of a chunk. Raises OSError, ENOSPC also before the disk is quite full."""
    refuse_full_disk(descriptor, len(chunk), free_bytes)
    left = memoryview(chunk)
    while left:
        left = left[os.write(descriptor, left) :]


def _append_file(file: Path, piece: Path, room: Quota) -> None:
    try:
        with piece.open("rb") as source, os.fdopen(_open(file), "ab") as target:
            refuse_full_disk(target.fileno(), piece.stat().st_size, room.free_bytes)
            shutil.copyfileobj(source, target, COPY_BYTES)
            target.flush()
            os.fsync(target.fileno())
    except OSError as error:
        raise (disk_full() if is_disk_full(error) else error) from error
