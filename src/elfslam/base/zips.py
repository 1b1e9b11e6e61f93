"""Zips from outside, unpacked."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from pathlib import Path

from elfslam.base.errors import InputError

DAMAGED_ZIP = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    OSError,
    EOFError,
    RuntimeError,
    ValueError,
    LookupError,
)
"""What zipfile lets through of an archive that was cut off, overwritten or made up."""


def unpack_zip(path: Path, folder: Path) -> None:
    """The files of a .zip put into `folder`. Raises InputError where missing or broken."""
    try:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
    except DAMAGED_ZIP as cause:
        raise InputError(f"{path}: is no whole .zip ({cause}); copy the file again") from cause
