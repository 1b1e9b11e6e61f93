"""Files made for one answer: packed or exported, sent, and gone, whoever is killed meanwhile."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO
from urllib.parse import quote

from fastapi.responses import StreamingResponse

from elfslam.serve import blobs
from elfslam.serve.settings import ServerSettings

CHUNK_BYTES = 2**18
LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""The date of every file in a .zip, so that equal content gives equal bytes."""
PACKED_ALREADY = (".npz", ".onnx", ".flac", ".zip", ".parquet", ".png", ".jpg")
ZIP = "application/zip"


@contextmanager
def unfolded(settings: ServerSettings, named: Mapping[str, str]) -> Iterator[Path]:
    """Blobs (their SHA-256 by name) as a folder to be read, for a moment."""
    with tempfile.TemporaryDirectory(dir=settings.work_folder, prefix="look-") as name:
        folder = Path(name) / "map"
        folder.mkdir()
        blobs.link_into(folder, settings.blobs_folder, named)
        yield folder


@contextmanager
def scratch_file(settings: ServerSettings, content: bytes) -> Iterator[Path]:
    """A file with that content, for a moment."""
    with tempfile.NamedTemporaryFile(dir=settings.work_folder, prefix="look-") as file:
        file.write(content)
        file.flush()
        yield Path(file.name)


def zipped(settings: ServerSettings, files: Mapping[str, Path]) -> IO[bytes]:
    """Files by their name within it, packed into a file without a name of its own."""
    packed: IO[bytes] = tempfile.TemporaryFile(dir=settings.work_folder)  # noqa: SIM115 - sent
    with zipfile.ZipFile(packed, "w") as archive:
        for name, file in files.items():
            entry = zipfile.ZipInfo(name, LONG_AGO)
            stored = file.suffix in PACKED_ALREADY or Path(name).suffix in PACKED_ALREADY
            entry.compress_type = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            with file.open("rb") as source, archive.open(entry, "w", force_zip64=True) as target:
                shutil.copyfileobj(source, target)
    return packed


def sent(file: IO[bytes], name: str, media_type: str) -> StreamingResponse:
    """An open file as a download, closed at its end."""
    size_bytes = file.seek(0, 2)
    headers = {
        "Content-Length": str(size_bytes),
        "Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}",
    }
    return StreamingResponse(_chunks(file), headers=headers, media_type=media_type)


def _chunks(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        file.seek(0)
        while chunk := file.read(CHUNK_BYTES):
            yield chunk
