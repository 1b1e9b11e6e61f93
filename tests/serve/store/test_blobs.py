"""Files by their content: kept once, laid out again, gone when nobody names them."""

from __future__ import annotations

import hashlib
import threading
from pathlib import Path

import pytest

from elfslam.serve.store import blobs


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    folder = tmp_path / "blobs"
    folder.mkdir()
    return folder


def written(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def test_a_file_is_kept_under_its_sha256(kept: Path, tmp_path: Path) -> None:
    blob = blobs.put(kept, written(tmp_path, "a", b"chirp"))
    sha256 = hashlib.sha256(b"chirp").hexdigest()
    assert blob == blobs.Blob(sha256, 5)
    assert (kept / sha256[:2] / sha256).read_bytes() == b"chirp"
    assert blobs.put(kept, written(tmp_path, "b", b"chirp")) == blob
    assert [path.name for path in kept.glob("*/*")] == [sha256]


def test_a_folder_comes_back_as_it_was(kept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    written(folder, "run.json", b"{}")
    written(folder, "arrays/map.npy", b"\x93NUMPY")
    named = blobs.put_folder(kept, folder)
    assert set(named) == {"run.json", "arrays/map.npy"}
    out = tmp_path / "out"
    out.mkdir()
    blobs.link_into(out, kept, {name: blob.sha256 for name, blob in named.items()})
    assert (out / "arrays/map.npy").read_bytes() == b"\x93NUMPY"


@pytest.mark.parametrize("name", ["../out.txt", "/etc/out.txt", "a/../../out.txt"])
def test_names_that_lead_out_are_refused(kept: Path, tmp_path: Path, name: str) -> None:
    blob = blobs.put(kept, written(tmp_path, "a", b"chirp"))
    (tmp_path / "out").mkdir()
    with pytest.raises(ValueError, match="leads out"):
        blobs.link_into(tmp_path / "out", kept, {name: blob.sha256})


@pytest.mark.parametrize("sha256", ["", "../../x", "A" * 64, "0" * 63, "0" * 64 + "\n"])
def test_what_is_no_sha256_has_no_place(kept: Path, sha256: str) -> None:
    with pytest.raises(ValueError, match="is no SHA-256"):
        blobs.blob_path(kept, sha256)


def test_a_link_to_elsewhere_is_not_kept(kept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "secret").symlink_to("/etc/passwd")
    assert blobs.put_folder(kept, folder) == {}


def test_one_at_a_time_is_alone(kept: Path) -> None:
    order: list[str] = []

    def second() -> None:
        with blobs.locked(kept):
            order.append("second")

    thread = threading.Thread(target=second)
    with blobs.locked(kept):
        thread.start()
        thread.join(0.1)
        order.append("first")
    thread.join()
    assert order == ["first", "second"]


def test_a_folder_in_the_place_of_a_blob_is_no_blob(kept: Path, tmp_path: Path) -> None:
    file = written(tmp_path, "a", b"chirp")
    blob = blobs.blob_of(file)
    place = blobs.blob_path(kept, blob.sha256)
    place.mkdir(parents=True)
    with pytest.raises(FileNotFoundError):
        blobs.found_blob(kept, blob.sha256)
    with pytest.raises(FileNotFoundError):
        blobs.link_into(tmp_path, kept, {"b": blob.sha256})
    blobs.delete(kept, [blob.sha256])
    assert place.is_dir()
    blobs.put(kept, file)
    assert blobs.found_blob(kept, blob.sha256).read_bytes() == b"chirp"
    assert len(list(place.parent.iterdir())) == 2, "the folder waits to be set aside"
