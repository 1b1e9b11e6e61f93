"""Blobs laid out to be read for a moment, and files that are made to be sent once."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from fastapi.responses import FileResponse, StreamingResponse

from elfslam.serve.people.access import not_found
from elfslam.serve.receiving.completing import scratch
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs

CHUNK_BYTES = 2**18
ZIP, BINARY = "application/zip", "application/octet-stream"


@contextmanager
def unfolded(settings: ServerSettings, named: Mapping[str, str]) -> Iterator[Path]:
    """Blobs (their SHA-256 by name) as a folder to be read, for a moment.

    Raises FileNotFoundError where one was deleted just now.
    """
    with scratch(settings) as around:
        folder = around / "map"
        folder.mkdir()
        blobs.link_into(folder, settings.blobs_folder, named)
        yield folder


def pieces(file: IO[bytes]) -> Iterator[bytes]:
    """An open file in pieces, closed at its end."""
    with file:
        while chunk := file.read(CHUNK_BYTES):
            yield chunk


def sent_blob(
    settings: ServerSettings, sha256: str, what: str, media_type: str, **more: Any
) -> FileResponse:
    """A blob as a response. Raises Problem 404 where it is gone, whoever names it."""
    try:
        file = blobs.found_blob(settings.blobs_folder, sha256)
    except FileNotFoundError as error:
        raise not_found(what) from error
    return FileResponse(file, media_type=media_type, **more)


def sent(content: Iterator[bytes], name: str, media_type: str) -> StreamingResponse:
    """Pieces of a file as a download of that name."""
    disposition = f"attachment; filename*=UTF-8''{quote(name, safe='')}"
    headers = {"Content-Disposition": disposition}
    return StreamingResponse(content, headers=headers, media_type=media_type)
