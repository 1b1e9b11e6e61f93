"""A real server process, killed without warning: whatever it worked on is done all the same."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.data.position_files import read_tum
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.truth import read_truth
from elfslam.serve.jobs.work import STAGES
from studies.benchmarks.served import PIECE, TUS, Served, metadata, start
from tests.waiting import until

pytestmark = pytest.mark.real

Json = dict[str, Any]
PATIENCE_S = 300.0
DATED = {"run.json", "timings.json", "report.html"}


@contextmanager
def running(data: Path) -> Iterator[tuple[Served, httpx.Client]]:
    """A server of a data folder, started anew, and a client of its owner; killed at the end."""
    served = start(data, jobs=True)
    try:
        with served.client() as client:
            yield served, client
    finally:
        served.kill()


def ended(client: httpx.Client, job_id: str) -> Json:
    def has_ended() -> bool:
        return job()["state"] not in ("queued", "running")

    def job() -> Json:
        answer: Json = client.get(f"/api/jobs/{job_id}").json()
        return answer

    until(has_ended, "the end of the job", patience_s=PATIENCE_S)
    return job()


def upload(client: httpx.Client, packed: bytes) -> str:
    """A whole recording as a .zip by tus; the id of the recording."""
    told = {"Upload-Length": str(len(packed)), "Upload-Metadata": metadata(filename="walk.zip")}
    created = client.post("/api/uploads", headers={**TUS, **told})
    assert created.status_code == 201, created.text
    where = created.headers["Location"]
    sent = client.patch(where, content=packed, headers={**PIECE, "Upload-Offset": "0"})
    assert sent.status_code == 204, sent.text
    return client.head(where, headers=TUS).headers["Elfslam-Recording"]


def packed(folder: Path) -> bytes:
    """A recording's folder as a .zip."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for file in folder.iterdir():
            archive.write(file, file.name)
    return made.getvalue()


def unpacked(content: bytes) -> dict[str, bytes]:
    """The files of a .zip by their names without folders."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {Path(name).name: archive.read(name) for name in archive.namelist()}


def only_job(client: httpx.Client, recording: str) -> Json:
    [job] = client.get("/api/jobs", params={"recording": recording}).json()
    return dict(job)


def run_folder(client: httpx.Client, map_id: str, folder: Path) -> Path:
    content = client.get(f"/api/maps/{map_id}/map.zip").content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(folder)
    [top] = folder.iterdir()
    return top


def median_error_m(run: Path, truth: Path) -> float:
    t_s, poses = read_tum(run / "trajectory.tum")
    return float(np.median(position_errors(t_s, poses, read_truth(truth), Alignment.ALIGNED)))


@pytest.fixture(scope="module")
def undisturbed(walks: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `elfslam map` makes of the walk."""
    out = tmp_path_factory.mktemp("undisturbed") / "run"
    job = MapJob((), None, "compact", Settings(), overwrite=False)
    map_into(out, walks / "one", job, lambda what, share: None)
    return out


def test_a_server_killed_while_it_maps_goes_on_and_makes_the_same_map(
    walks: Path, undisturbed: Path, tmp_path: Path
) -> None:
    with running(tmp_path / "data") as (served, client):
        recording = upload(client, packed(walks / "one"))
        job_id = only_job(client, recording)["id"]
        until(
            lambda: client.get(f"/api/jobs/{job_id}").json()["doing"] in STAGES,
            "a stage of mapping",
        )
        served.kill()
    assert list((tmp_path / "data" / "work").iterdir()) != []
    with running(tmp_path / "data") as (_, client):
        job = ended(client, job_id)
        assert (job["state"], job["attempts"]) == ("done", 2)
        ours = run_folder(client, job["gave"]["map"], tmp_path / "map")
        assert len(client.get("/api/maps").json()) == 1
    names = {file.name for file in ours.iterdir()}
    assert names == {file.name for file in undisturbed.iterdir()}
    for name in names - DATED:
        assert (ours / name).read_bytes() == (undisturbed / name).read_bytes(), name
    assert median_error_m(ours, walks / "one") < 0.3
    assert list((tmp_path / "data" / "work").iterdir()) == []
