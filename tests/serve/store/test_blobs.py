"""Files by their content: kept once, sent, packed, and taken out of zips, whose tricks are not."""

import hashlib
import threading
import zipfile
from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.problems import Problem
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits
from elfslam.serve.store import blobs
from elfslam.serve.store.sending import sent_blob
from elfslam.serve.store.zips import packed, unpack_recording
from tests.serve.conftest import Somebody
from tests.serve.uploading import unzipped


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


def test_a_blob_that_is_gone_is_a_refusal(services: Services) -> None:
    store = services.settings.blobs_folder
    file = store.parent / "report"
    file.write_bytes(b"content")
    blob = blobs.put(store, file)
    response = sent_blob(services.settings, blob.sha256, "report", "text/html", filename="a")
    assert (response.path, response.media_type) == (
        blobs.blob_path(store, blob.sha256),
        "text/html",
    )
    blobs.blob_path(store, blob.sha256).unlink()
    with pytest.raises(Problem, match="no such report here") as refused:
        sent_blob(services.settings, blob.sha256, "report", "text/html")
    assert refused.value.status_code == 404


def test_a_blob_that_is_a_folder_is_as_one_that_is_gone(owner: Somebody) -> None:
    map_id, store = owner.put_map(), owner.services.settings.blobs_folder
    (blob,) = store.glob("*/*")
    blob.unlink()
    blob.mkdir()
    for what in ("report.html", "map.zip", "view", "export/tum", "package"):
        assert owner.get(f"/api/maps/{map_id}/{what}").status_code in (404, 422), what
    assert owner.delete(f"/api/maps/{map_id}").status_code == 204
    assert owner.get(f"/api/maps/{map_id}").status_code == 404


SMALL = Limits(file_bytes=10_000, recording_bytes=15_000, free_bytes=0)


def zipped(path: Path, entries: list[tuple[str | zipfile.ZipInfo, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


def unpacked(path: Path, folder: Path, limits: Limits = SMALL) -> dict[str, bytes]:
    folder.mkdir()
    unpack_recording(path, folder, limits)
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("folder", ["", "walk/", "./walk/"])
def test_a_recording_is_taken_out(tmp_path: Path, folder: str) -> None:
    entries: list[tuple[str | zipfile.ZipInfo, bytes]] = [
        (f"{folder}recording.json", b"{}"),
        (f"{folder}wifi.csv", b"t_s"),
        (f"{folder}notes.txt", b"not ours"),
        ("__MACOSX/walk/recording.json", b"not ours either"),
    ]
    found = unpacked(zipped(tmp_path / "w.zip", entries), tmp_path / "out")
    assert found == {"recording.json": b"{}", "wifi.csv": b"t_s"}


def test_hostile_zips_are_refused(tmp_path: Path) -> None:
    """That they are, and how, is told of every zip."""
    path = zipped(tmp_path / "w.zip", [("../recording.json", b"x")])
    with pytest.raises(InputError, match="leads out"):
        unpacked(path, tmp_path / "out")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["out", "w.zip"]


def test_bombs_are_refused_before_they_go_off(tmp_path: Path) -> None:
    large = zipped(tmp_path / "large.zip", [("wifi.csv", bytes(10_001))])
    with pytest.raises(InputError, match="unpacks to more than 10000"):
        unpacked(large, tmp_path / "one")
    two = [("wifi.csv", bytes(9_000)), ("emr.csv", bytes(9_000))]
    with pytest.raises(InputError, match="unpacks to more than 15000"):
        unpacked(zipped(tmp_path / "two.zip", two), tmp_path / "two")
    assert not any((tmp_path / "one").iterdir())


@pytest.mark.parametrize(
    "names",
    [["a/recording.json", "b/wifi.csv"], ["recording.json", "a/recording.json"], ["a/b/wifi.csv"]],
)
def test_several_recordings_are_refused(tmp_path: Path, names: list[str]) -> None:
    path = zipped(tmp_path / "w.zip", [(name, b"{}") for name in names])
    with pytest.raises(InputError, match="pack one recording alone"):
        unpacked(path, tmp_path / "out")


def test_every_cut_is_refused_in_words(tmp_path: Path) -> None:
    whole = zipped(tmp_path / "w.zip", [("recording.json", b"{}" * 50)]).read_bytes()
    for length in range(0, len(whole), 7):
        (tmp_path / "cut.zip").write_bytes(whole[:length])
        with pytest.raises(InputError, match="not whole"):
            unpacked(tmp_path / "cut.zip", tmp_path / f"out{length}")


def test_what_is_packed_unpacks(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"chirp" * 100_000)
    (tmp_path / "b").write_bytes(b"")
    files = {"audio.flac": tmp_path / "a", "recording.json": tmp_path / "b"}
    sent = b"".join(packed(files))
    assert sent == b"".join(packed(files))
    assert unzipped(sent) == {name: file.read_bytes() for name, file in files.items()}


def test_what_is_deleted_meanwhile_is_still_sent(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"chirp")
    pieces = packed({"audio.flac": tmp_path / "a"})
    (tmp_path / "a").unlink()
    assert unzipped(b"".join(pieces)) == {"audio.flac": b"chirp"}
    with pytest.raises(FileNotFoundError):
        packed({"audio.flac": tmp_path / "a"})
