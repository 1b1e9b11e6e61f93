"""Zips from outside: what is whole comes out, what is not is refused in one line."""

from __future__ import annotations

import zipfile
from pathlib import Path
from shutil import rmtree

from elfslam.base.errors import InputError
from elfslam.base.zips import unpack_zip


def test_an_overwritten_zip_is_refused_whatever_byte_it_was(tmp_path: Path) -> None:
    """The name as the archive's index says it is not the name beside the file's own bytes."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("größe.txt", b"x" * 50)
    whole = (tmp_path / "a.zip").read_bytes()
    refused = set()
    for at in range(len(whole)):
        for byte in (0, 0xF6, 0xFF):
            (tmp_path / "a.zip").write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
            try:
                unpack_zip(tmp_path / "a.zip", tmp_path / "out")
            except InputError:
                refused.add(at)
            rmtree(tmp_path / "out", ignore_errors=True)
    content = range(whole.index(b"x" * 50), whole.index(b"x" * 50) + 50)
    assert refused.issuperset(content), "the checksum notices"
    assert len(refused) < len(whole), "not every byte matters"
