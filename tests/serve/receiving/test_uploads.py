"""Resumable uploads: what is acknowledged is there, whatever comes in between."""

import base64
import hashlib
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.services import Services
from studies.benchmarks.served import PIECE, TUS, metadata
from tests.serve.conftest import DATABASES, Somebody
from tests.serve.uploading import append, begun, created, offset_of, uploading

pytestmark = DATABASES
DATA = bytes(range(256)) * 40


@pytest.fixture
def place(owner: Somebody) -> str:
    return uploading(owner, len(DATA))


def on_disk(services: Services, place: str) -> bytes:
    return (services.settings.uploads_folder / place.rpartition("/")[2]).read_bytes()


def test_a_number_is_digits_alone(owner: Somebody, place: str) -> None:
    told = {**TUS, "Upload-Metadata": metadata(filename="walk.zip")}
    for number in ("5_0", " 50", "+50", "5e1", "50.0", "0x32", "", "\u0665\u0660"):
        begun_so: Any = {**told, b"Upload-Length": number.encode()}
        assert owner.post("/api/uploads", headers=begun_so).status_code in (400, 422), number
        offset: Any = {**PIECE, b"Upload-Offset": number.encode()}
        assert owner.patch(place, headers=offset, content=b"x").status_code == 422, number
    assert offset_of(owner, place) == 0


def test_what_is_spoken_is_said(owner: Somebody) -> None:
    answer = owner.options("/api/uploads")
    assert answer.status_code == 204
    assert answer.headers["tus-version"] == "1.0.0"
    assert "creation-defer-length" in answer.headers["tus-extension"]
    assert answer.headers["tus-checksum-algorithm"] == "sha256,sha1"


def test_pieces_become_the_file(owner: Somebody, services: Services, place: str) -> None:
    assert append(owner, place, 0, DATA[:5000]).status_code == 204
    assert offset_of(owner, place) == 5000
    assert append(owner, place, 5000, DATA[5000:]).status_code == 204
    assert on_disk(services, place) == DATA
    head = owner.head(place, headers=TUS).headers
    assert head["upload-length"] == str(len(DATA))
    assert head["cache-control"] == "no-store"
    assert "GMT" in head["upload-expires"]
    assert metadata(filename="wifi.csv") in head["upload-metadata"]


def test_reordered_and_repeated_pieces_are_refused(owner: Somebody, place: str) -> None:
    assert append(owner, place, 5000, DATA[5000:]).status_code == 409
    assert append(owner, place, 0, DATA[:5000]).status_code == 204
    assert append(owner, place, 0, DATA[:5000]).status_code == 409
    assert on_disk(owner.services, place) == DATA[:5000]


def test_more_than_was_said_is_refused(owner: Somebody, services: Services, place: str) -> None:
    assert append(owner, place, 0, DATA + b"more").status_code == 413
    assert on_disk(services, place) == b""


@pytest.mark.parametrize("algorithm", ["sha256", "sha1"])
def test_a_checked_piece(owner: Somebody, services: Services, place: str, algorithm: str) -> None:
    digest = base64.b64encode(hashlib.new(algorithm, DATA[:100]).digest()).decode()
    checked = {"Upload-Checksum": f"{algorithm} {digest}"}
    assert append(owner, place, 0, DATA[1:101], **checked).status_code == 460
    assert on_disk(services, place) == b""
    assert append(owner, place, 0, DATA[:100], **checked).status_code == 204
    assert on_disk(services, place) == DATA[:100]
    assert sorted(path.name for path in services.settings.uploads_folder.iterdir()) == [
        place.rpartition("/")[2]
    ]


def test_an_unknown_checksum_is_refused(owner: Somebody, place: str) -> None:
    for checksum in ("md5 AAAA", "sha256 not-base64!", "sha256"):
        wanted = 460 if checksum == "sha256" else 400
        assert append(owner, place, 0, DATA, **{"Upload-Checksum": checksum}).status_code == wanted


def test_a_deferred_length_is_said_once(owner: Somebody) -> None:
    place = uploading(owner)
    assert owner.head(place, headers=TUS).headers["upload-defer-length"] == "1"
    assert append(owner, place, 0, DATA).status_code == 204
    assert append(owner, place, len(DATA), b"", **{"Upload-Length": "10"}).status_code == 409
    assert (
        append(owner, place, len(DATA), b"end", **{"Upload-Length": str(len(DATA) + 3)}).status_code
        == 204
    )
    assert owner.head(place, headers=TUS).headers["upload-length"] == str(len(DATA) + 3)
    assert (
        append(
            owner, place, len(DATA) + 3, b"", **{"Upload-Length": str(len(DATA) + 9)}
        ).status_code
        == 409
    )


def test_creation_with_upload(owner: Somebody, services: Services) -> None:
    answer = created(owner, len(DATA), DATA[:700], recording=begun(owner), filename="wifi.csv")
    assert answer.status_code == 201
    assert answer.headers["upload-offset"] == "700"
    assert on_disk(services, answer.headers["location"]) == DATA[:700]


def test_a_creation_whose_body_is_refused_leaves_nothing(owner: Somebody) -> None:
    answer = created(owner, 3, DATA, recording=begun(owner), filename="wifi.csv")
    assert answer.status_code == 413
    assert owner.get("/api/recordings").json()[0]["uploads"] == []
    assert list(owner.services.settings.uploads_folder.iterdir()) == []


def test_termination_deletes(owner: Somebody, services: Services, place: str) -> None:
    assert append(owner, place, 0, DATA).status_code == 204
    assert owner.delete(place, headers=TUS).status_code == 204
    assert owner.head(place, headers=TUS).status_code == 404
    assert list(services.settings.uploads_folder.iterdir()) == []


def test_one_writer_at_a_time(owner: Somebody, services: Services, place: str) -> None:
    with services.busy.alone([place.rpartition("/")[2]]):
        assert append(owner, place, 0, DATA).status_code == 423
        assert owner.delete(place, headers=TUS).status_code == 423
    assert append(owner, place, 0, DATA).status_code == 204


def test_headers_that_are_wrong(owner: Somebody, place: str) -> None:
    for name, wrong, status in (
        ("Tus-Resumable", "0.2.2", 412),
        ("Content-Type", "application/octet-stream", 415),
        *(("Upload-Offset", offset, 422) for offset in ("-1", "many", str(2**70))),
    ):
        sent = {**PIECE, "Upload-Offset": "0", name: wrong}
        answer = owner.patch(place, headers=sent, content=DATA)
        assert answer.status_code == status, (name, wrong)
        assert answer.headers["content-type"] == "application/problem+json"


NAMES = "../../etc/passwd /etc/passwd .. audio.flac/../x audio.flac\0 AUDIO.FLAC C:\\audio.flac"
NAMES += " audio\u202e.flac ../walk\0.zip \x1b[2J.zip"


def test_tricks_in_names_are_refused(owner: Somebody, services: Services) -> None:
    pair = {"recording": begun(owner)}
    for name in ("", "'; DROP TABLE uploads; --", *NAMES.split()):
        more = {} if name.endswith(".zip") else pair
        assert created(owner, 1, filename=name, **more).status_code == 400, name
    assert list(services.settings.uploads_folder.iterdir()) == []


def test_a_creation_that_is_none(owner: Somebody) -> None:
    for wrong in ("filename ???", "filename", "a YQ==,a YQ==", "x" * 5000, "filename /w=="):
        headers = {**TUS, "Upload-Metadata": wrong, "Upload-Length": "1"}
        assert owner.post("/api/uploads", headers=headers).status_code == 400, wrong
    told = metadata(recording=begun(owner), filename="wifi.csv")
    both = {"Upload-Length": "5", "Upload-Defer-Length": "1"}
    for length in ({}, both, {"Upload-Defer-Length": "2"}):
        answer = owner.post("/api/uploads", headers={**TUS, "Upload-Metadata": told, **length})
        assert answer.status_code == 400, length


def test_two_gigabytes_are_refused_before_they_come(owner: Somebody, place: str) -> None:
    huge = {"Content-Length": str(2 * 2**30)}
    assert append(owner, place, 0, b"", **huge).status_code == 413
    assert owner.post("/api/recordings", headers=huge, content=b"{}").status_code == 413
    told = {"recording": begun(owner), "filename": "wifi.csv"}
    assert created(owner, 2 * 2**30, **told).status_code == 413


def test_another_users_upload_is_not_there(owner: Somebody, guest: Somebody, place: str) -> None:
    assert guest.head(place, headers=TUS).status_code == 404
    assert append(guest, place, 0, DATA).status_code == 404
    assert guest.delete(place, headers=TUS).status_code == 404
    told = {"recording": begun(owner), "filename": "wifi.csv"}
    assert created(guest, 1, **told).status_code == 404


def test_a_method_in_a_header(owner: Somebody, services: Services, place: str) -> None:
    sent = {**PIECE, "Upload-Offset": "0", "X-HTTP-Method-Override": "PATCH"}
    assert owner.post(place, headers=sent, content=DATA[:9]).status_code == 204
    assert on_disk(services, place) == DATA[:9]
    assert owner.post("/api/me", headers={"X-HTTP-Method-Override": "GET"}).status_code == 405


def test_a_piece_left_by_a_kill_is_not_taken_for_ours(owner: Somebody, place: str) -> None:
    left: Path = owner.services.settings.uploads_folder / (place.rpartition("/")[2] + ".piece")
    left.write_bytes(b"left over")
    digest = base64.b64encode(hashlib.sha256(DATA).digest()).decode()
    assert (
        append(owner, place, 0, DATA, **{"Upload-Checksum": f"sha256 {digest}"}).status_code == 204
    )
    assert on_disk(owner.services, place) == DATA
