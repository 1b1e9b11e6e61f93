"""Recordings as phones and browsers upload them: begun, and sent by tus in pieces or whole."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx

from studies.benchmarks.served import PIECE, TUS, metadata

Files = Mapping[str, bytes | str]


def begun(client: httpx.Client, name: str = "walk", **more: Any) -> str:
    """A recording that is being received; its id."""
    answer = client.post("/api/recordings", json={"name": name, **more})
    assert answer.status_code == 201, answer.text
    assert answer.json()["state"] == "receiving"
    return str(answer.json()["id"])


def created(
    client: httpx.Client,
    length: int | None = None,
    content: bytes = b"",
    headers: Mapping[str, str] | None = None,
    **pairs: str,
) -> httpx.Response:
    """What is answered to beginning an upload that these pairs tell of, its length or not yet."""
    told = {**(PIECE if content else TUS), "Upload-Metadata": metadata(**pairs)}
    told |= {"Upload-Defer-Length": "1"} if length is None else {"Upload-Length": str(length)}
    return client.post("/api/uploads", headers={**told, **(headers or {})}, content=content)


def uploading(client: httpx.Client, length: int | None = None, name: str = "wifi.csv") -> str:
    """An upload for a new recording; its address."""
    made = created(client, length, recording=begun(client), filename=name)
    assert made.status_code == 201, made.text
    return str(made.headers["location"])


def append(
    client: httpx.Client, place: str, offset: int, content: Any, **headers: str
) -> httpx.Response:
    """What is answered to a piece."""
    told = {**PIECE, "Upload-Offset": str(offset), **headers}
    return client.patch(place, headers=told, content=content)


def offset_of(client: httpx.Client, place: str) -> int:
    """How much of an upload has come."""
    return int(client.head(place, headers=TUS).headers["upload-offset"])


def send_all(client: httpx.Client, recording: str, files: Mapping[str, bytes]) -> None:
    """The files of a recording, each whole."""
    for name, content in files.items():
        made = created(client, len(content), content, recording=recording, filename=name)
        assert made.status_code == 201, made.text


def recording_of(client: httpx.Client, name: str, content: bytes, **pairs: str) -> str:
    """The recording that comes of a file, the first of several."""
    made = created(client, len(content), content, filename=name, **pairs)
    assert made.status_code == 201, made.text
    head = client.head(made.headers["location"], headers=TUS)
    assert head.headers["elfslam-recording"] == made.headers["elfslam-recording"]
    return str(made.headers["elfslam-recording"])


def zipped(files: Files | Path, folder: str = "", method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Files by name, or those of a folder, as a .zip; in it they lie in `folder`."""
    if isinstance(files, Path):
        files = {file.name: file.read_bytes() for file in files.iterdir()}
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", method) as archive:
        for name, content in files.items():
            archive.writestr(folder + name, content)
    return made.getvalue()


def unzipped(content: bytes) -> dict[str, bytes]:
    """The files of a .zip by their names without folders."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {Path(name).name: archive.read(name) for name in archive.namelist()}
