"""Whole recordings and logs as files: the server opens none itself, and refuses in words."""

import io
import struct
import tarfile
from pathlib import Path

import pytest
from damaged_formats import changed_lzma, zip_directory
from planted_logs import LOGS

from elfslam.data.importing import LogFormat
from elfslam.serve.parsing.children import Children
from elfslam.serve.problems import Problem
from elfslam.serve.receiving.reader import Walk, walks_apart
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits
from elfslam.serve.store.zips import FILE_NAMES
from tests.data.foreign_walk import put_back
from tests.serve.conftest import Somebody
from tests.serve.uploading import created, recording_of, zipped

MOST = 3


ABOUT = '{"format_version": 1, "device": "phone"}'
WALK = {
    "recording.json": ABOUT,
    "wifi.csv": "t_s,bssid,rssi_dbm,frequency_mhz,age_s\n" + "0,a,-50,,0\n",
}


DAMAGED = {
    "a byte of LZMA": changed_lzma("recording.json", ABOUT.encode()),
    "a directory without end": zip_directory(100_000),
    "a size that lies": zipped(WALK).replace(
        struct.pack("<L", len(ABOUT)), struct.pack("<L", 9_999_999)
    ),
    "half of it": zipped(WALK)[:150],
}
"""A tenth of the directory that costs its sender 47 MB is over the limit."""


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_hostile_zip_becomes_a_refused_recording(
    owner: Somebody, services: Services, damage: str
) -> None:
    kept = owner.get(f"/api/recordings/{recording_of(owner, 'walk.zip', DAMAGED[damage])}").json()
    assert (kept["state"], kept["files"]) == ("refused", [])
    assert kept["refusal"].startswith("the .zip")
    assert str(services.settings.data_folder) not in kept["refusal"]
    assert list(services.settings.work_folder.iterdir()) == []
    assert list(services.settings.blobs_folder.glob("*/*")) == []


def read(tmp_path: Path, name: str = "walk.zip", **limits: float) -> list[Walk]:
    """What is found in a file of that name; what comes of it lies in out/."""
    (tmp_path / "out").mkdir()
    known = Limits(**{"free_bytes": 0, **limits})  # type: ignore[arg-type]
    return walks_apart(Children(), tmp_path / name, tmp_path / "out", MOST, known)


def test_what_is_in_a_zip_is_read_where_it_was_unpacked(tmp_path: Path) -> None:
    (tmp_path / "walk.zip").write_bytes(zipped(WALK))
    (walk,) = read(tmp_path)
    assert (walk.found.refusal, walk.place) == (None, "walk")
    assert (walk.found.facts["device"], walk.found.facts["sensors"]) == ("phone", ["wifi"])
    kept = {file.name for file in (tmp_path / "out" / "walk").iterdir()}
    assert kept == {"recording.json", "wifi.csv"}


def test_a_disk_without_room_is_no_refusal(tmp_path: Path) -> None:
    (tmp_path / "walk.zip").write_bytes(zipped(WALK))
    with pytest.raises(Problem, match="507: "):
        read(tmp_path, free_bytes=2**62)


def test_a_zip_that_is_cut_off_while_unpacking_leaves_no_file(tmp_path: Path) -> None:
    """Its second file is damaged: the first is none of the recording's either."""
    whole = zipped(WALK)
    at = whole.index(b"wifi.csv") + 12
    (tmp_path / "walk.zip").write_bytes(whole[:at] + b"\xff\xff\xff" + whole[at + 3 :])
    (walk,) = read(tmp_path)
    assert "not whole" in str(walk.found.refusal)
    assert walk.place is None


MALL = "".join(
    f"{20 * k}\tTYPE_{kind}\t0.1\t0.2\t9.8\t3\n"
    for k in range(80)
    for kind in ("ACCELEROMETER", "GYROSCOPE")
)


@pytest.mark.parametrize("log_format", LOGS)
def test_a_log_of_another_program_becomes_a_recording(
    tmp_path: Path, log_format: LogFormat
) -> None:
    files = LOGS[log_format]()
    if log_format is LogFormat.GETSENSORDATA:
        (tmp_path / "walk.zip").write_text(files["walk.txt"])
    else:
        (tmp_path / "walk.zip").write_bytes(zipped(files))
    (walk,) = read(tmp_path)
    assert walk.found.refusal is None
    assert walk.found.facts["imported"] == log_format
    assert walk.found.facts["name"] == "walk"
    assert walk.found.facts["chirps"] == (log_format is LogFormat.PHYPHOX)
    kept = {file.name for file in (tmp_path / "out" / str(walk.place)).iterdir()}
    assert {"recording.json", "accelerometer.csv", "gyroscope.csv"} <= kept <= FILE_NAMES
    left = [file for file in (tmp_path / "out").iterdir() if file.name != walk.place]
    assert left == [], "nothing that was unpacked stays"


def test_what_was_noted_of_a_log_is_told_with_its_recording(tmp_path: Path) -> None:
    (tmp_path / "walk.zip").write_bytes(zipped(put_back(60)))
    (walk,) = read(tmp_path)
    assert walk.found.facts["damaged_lines"] == 0
    assert walk.found.facts["notes"][0].startswith("the clock was put back by 59.99 s at 7.99 s")


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"recording_bytes": 2_000}, "unpacks to"),
        ({"file_bytes": 1_000}, "accelerometer.csv: becomes"),
        ({"reading_s": 0.01}, "takes longer than 0.01 s"),
        ({"reading_bytes": 2**23}, "needs more than 8 MB of memory"),
    ],
)
def test_what_a_log_may_cost(tmp_path: Path, limits: dict[str, float], words: str) -> None:
    long_line = "1600\tTYPE_OTHER\t" + "9" * 2**26 + "\n" if "reading_bytes" in limits else ""
    (tmp_path / "walk.zip").write_bytes(zipped({"walk.txt": MALL + long_line}))
    (walk,) = read(tmp_path, **limits)
    assert words in str(walk.found.refusal)
    assert str(tmp_path) not in str(walk.found.refusal)
    assert walk.place is None


def test_a_log_for_which_the_disk_has_no_room_is_no_refusal(tmp_path: Path) -> None:
    (tmp_path / "walk.zip").write_bytes(zipped({"walk.txt": MALL}))
    with pytest.raises(Problem, match="507: "):
        read(tmp_path, free_bytes=2**62)


def test_what_all_walks_of_an_archive_may_become(tmp_path: Path) -> None:
    """Nobody knows it before they are unpacked."""
    with tarfile.open(tmp_path / "walks.tar.xz", "w:xz") as archive:
        for name in ("one.txt", "two.txt"):
            entry = tarfile.TarInfo(name)
            entry.size = len(MALL)
            archive.addfile(entry, io.BytesIO(MALL.encode()))
    (walk,) = read(tmp_path, "walks.tar.xz", recording_bytes=len(MALL))
    assert f"its walks are more than {len(MALL)} bytes" in str(walk.found.refusal)
    assert walk.place is None


def test_more_walks_than_are_taken_are_refused(tmp_path: Path) -> None:
    (tmp_path / "walk.zip").write_bytes(zipped({f"{k}.txt": MALL for k in range(MOST + 1)}))
    (walk,) = read(tmp_path)
    assert "holds more than 3 walks" in str(walk.found.refusal)


def test_each_walk_of_a_file_becomes_a_recording_with_its_name(owner: Somebody) -> None:
    data = zipped({"one.txt": MALL, "two.txt": "1\tTYPE_X\t1\n"})
    first = recording_of(owner, "walks.zip", data)
    kept = {each["name"]: each for each in owner.get("/api/recordings").json()}
    assert {name: each["state"] for name, each in kept.items()} == {
        "one": "ready",
        "two": "refused",
    }
    assert first == kept["one"]["id"]
    assert kept["two"]["refusal"].startswith("two.txt: has no TYPE_ACCELEROMETER records")
    jobs = [job["given"]["recording"] for job in owner.get("/api/jobs").json()]
    assert jobs == [first], "what was refused is not mapped"
    assert list(owner.services.settings.work_folder.iterdir()) == []
    assert list(owner.services.settings.uploads_folder.iterdir()) == []


def test_a_file_that_must_wait_too_long_leaves_no_upload(
    owner: Somebody, services: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever sent it was not told where it lies, and sends it again."""

    async def refuse(*_: object) -> None:
        raise Problem(429, "others are being read")

    with monkeypatch.context() as patch:
        patch.setattr(services.reading, "run", refuse)
        refused = created(owner, len(MALL), MALL.encode(), filename="walk.txt")
        assert refused.status_code == 429
        assert list(services.settings.uploads_folder.iterdir()) == []
    recording_of(owner, "walk.txt", MALL.encode())
    assert len(owner.get("/api/recordings").json()) == 1


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("round the hall.TXT", "round the hall"),
        ("../../over/walk.txt", ".._.._over_walk"),
        ("路" * 100 + ".txt", "路" * 66),
        (".txt.txt", "txt"),
    ],
)
def test_a_walk_is_called_as_its_file(owner: Somebody, name: str, kept: str) -> None:
    told = owner.get(f"/api/recordings/{recording_of(owner, name, MALL.encode())}").json()
    assert (told["name"], told["state"]) == (kept.lstrip("."), "ready")


def test_sound_of_a_program_that_plays_no_chirps_is_mapped_by_motion(owner: Somebody) -> None:
    told = recording_of(owner, "walk.txt", MALL.encode())
    (job,) = owner.get("/api/jobs").json()
    assert job["given"] == {"recording": told, "by": ["motion"]}


def test_what_ends_in_nothing_known_is_not_begun(owner: Somebody) -> None:
    for name in ("walk.pdf", "walk.csv", "walk", "audio.flac", ".zi"):
        answer = created(owner, 1, filename=name)
        assert answer.status_code == 400, name
        assert ".tar.xz" in answer.json()["detail"]
