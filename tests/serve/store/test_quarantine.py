"""Files that nobody names are moved, not deleted."""

from __future__ import annotations

from pathlib import Path

from elfslam.serve.store.blobs import blob_path
from elfslam.serve.store.quarantine import put_back, set_aside, unnamed_blobs

NAMED, UNNAMED = "a" * 64, "b" * 64


def test_what_is_named_stays_and_the_rest_is_moved_whole(tmp_path: Path) -> None:
    blobs, quarantine = tmp_path / "blobs", tmp_path / "quarantine"
    quarantine.mkdir()
    for name in (NAMED, UNNAMED):
        blob_path(blobs, name).parent.mkdir(parents=True)
        blob_path(blobs, name).write_text(name)
    (blobs / "aa" / "0123.partial").write_text("half")
    found = unnamed_blobs(blobs, lambda sha256: sha256 == NAMED)
    assert set_aside(found, quarantine) == 2
    assert {file.name for file in blobs.glob("*/*")} == {NAMED}
    assert (quarantine / UNNAMED).read_text() == UNNAMED
    assert put_back(quarantine, blobs, lambda sha256: True) == 1
    assert blob_path(blobs, UNNAMED).read_text() == UNNAMED
    assert [file.name for file in quarantine.iterdir()] == ["0123.partial"]
