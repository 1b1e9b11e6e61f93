"""Bytes of a request body put to the end of a file, synced before anybody is told so.

Whatever happens, the file's length is what has come: it is cut by nothing, only a piece with a
checksum first lies beside the file, so that bytes that were not checked never become part of it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.types import Receive

from elfslam.serve.problems import Problem, disk_full, is_disk_full
from elfslam.serve.receiving.tus import Checksum, wrong_checksum
from elfslam.serve.store.disk_room import refuse_full_disk

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
        hasher = checksum.hasher()
        await _write_body(piece, receive, room, hasher)
        if hasher.digest() != checksum.digest:
            raise wrong_checksum()
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
