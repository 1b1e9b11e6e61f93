"""What one user may cost: bytes, counts, and the time and memory of reading."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from elfslam.serve.parsing.children import Children
from elfslam.serve.problems import Problem
from elfslam.serve.receiving.reader import read_apart
from elfslam.serve.settings import Limits
from tests.serve.conftest import Somebody, allow
from tests.serve.uploading import append, begun, created


def upload(client: Somebody, walk: str, name: str = "wifi.csv") -> str:
    return str(created(client, recording=walk, filename=name).headers["location"])


def status(client: Somebody, walk: str, name: str = "wifi.csv", length: int | None = None) -> int:
    """What comes of beginning an upload."""
    return created(client, length, recording=walk, filename=name).status_code


def test_a_file_has_a_size(owner: Somebody) -> None:
    allow(owner.services, file_bytes=1000)
    walk = begun(owner)
    assert status(owner, walk, length=1001) == 413
    place = upload(owner, walk)
    assert append(owner, place, 0, bytes(900)).status_code == 204
    assert append(owner, place, 900, bytes(101)).status_code == 413
    assert append(owner, place, 900, bytes(100)).status_code == 204


def test_a_recording_has_a_size(owner: Somebody) -> None:
    allow(owner.services, recording_bytes=1000)
    walk = begun(owner)
    first, second = upload(owner, walk), upload(owner, walk, "emr.csv")
    assert append(owner, first, 0, bytes(800)).status_code == 204
    assert append(owner, second, 0, bytes(300)).status_code == 413
    assert append(owner, second, 0, bytes(200)).status_code == 204
    assert append(owner, upload(owner, begun(owner)), 0, bytes(800)).status_code == 204


def test_a_user_has_a_size(owner: Somebody) -> None:
    allow(owner.services, user_bytes=1000)
    first, second = begun(owner), begun(owner)
    assert append(owner, upload(owner, first), 0, bytes(800)).status_code == 204
    assert status(owner, second, length=300) == 413
    assert owner.get("/api/me").json()["used_bytes"] == 800
    assert owner.delete(f"/api/recordings/{first}").status_code == 204
    assert status(owner, second, length=300) == 201


def test_counts_have_an_end(owner: Somebody) -> None:
    allow(owner.services, recordings=2, open_uploads=2, users=2)
    walk = begun(owner)
    assert owner.post("/api/recordings", json={"name": "w"}).status_code == 201
    assert owner.post("/api/recordings", json={"name": "w"}).status_code == 409
    codes = [status(owner, walk, name) for name in ("wifi.csv", "emr.csv", "audio.wav")]
    assert codes == [201, 201, 409]
    assert owner.post("/api/users", json={"name": "a"}).status_code == 201
    assert owner.post("/api/users", json={"name": "b"}).status_code == 409


def test_requests_that_are_no_uploads_are_small(owner: Somebody) -> None:
    allow(owner.services, request_bytes=100)
    assert owner.post("/api/recordings", json={"name": "w" * 110}).status_code == 413
    pieces = (b'{"name": "', b"w" * 110, b'"}')
    sent = {"Content-Type": "application/json"}
    answer = owner.post("/api/recordings", content=iter(pieces), headers=sent)
    assert answer.status_code == 413


def test_reading_has_an_end(tmp_path: Path) -> None:
    """Silence packs a thousandfold: a small file that becomes large when it is read."""
    (tmp_path / "recording.json").write_text('{"format_version": 1}')
    soundfile.write(tmp_path / "audio.flac", np.zeros(20 * 44_100), 44_100)
    assert (tmp_path / "audio.flac").stat().st_size < 20_000
    assert read_apart(Children(), tmp_path, Limits()).facts["duration_s"] == 20.0
    late = read_apart(Children(), tmp_path, Limits(reading_s=0.001))
    assert "takes longer than 0.001 s" in str(late.refusal)
    large = read_apart(Children(), tmp_path, Limits(reading_bytes=2**20))
    assert "needs more than 1 MB of memory" in str(large.refusal)


def test_a_reader_that_dies_is_no_refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("elfslam.serve.receiving.reader.READER", "elfslam.no_such_reader:parse")
    with pytest.raises(Problem) as refused:
        read_apart(Children(), tmp_path, Limits())
    assert refused.value.status_code == 503
    assert "try again" in str(refused.value.detail)
