"""Jobs from the queue to a map, whatever happens on the way."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from starlette.testclient import TestClient

from elfslam.mapping import MapJob, map_into
from elfslam.senses import Settings
from elfslam.serve.services import Services

Json = dict[str, Any]
Remember = Callable[[TestClient, str], str]
Wait = Callable[[TestClient, str], Json]


AS_THE_COMMAND = MapJob((), None, "compact", Settings(), overwrite=False)


def ignore(what: str, share: float | None) -> None:
    """Nobody watches."""


def start(client: TestClient, **given: object) -> str:
    answer = client.post("/api/jobs", json=given)
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def test_a_walk_becomes_the_map_that_the_command_makes_of_it(
    owner: TestClient, remember: Remember, ended: Wait, walks: Path, tmp_path: Path,
    services: Services,
) -> None:  # fmt: skip
    recording = remember(owner, "one")
    job = ended(owner, start(owner, kind="map", recording=recording))
    assert (job["state"], job["problem"]) == ("done", None)
    made = owner.get(f"/api/maps/{job['gave']['map']}").json()
    assert made["sources"] == [recording]
    assert made["facts"]["status"] == "OK"
    map_into(
        tmp_path / "run", walks / "one", MapJob((), None, "compact", Settings(), False), ignore
    )
    packed = owner.get(f"/api/maps/{made['id']}/map.zip").content
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        archive.extractall(tmp_path)
    ours = {file.name: file.read_bytes() for file in (tmp_path / "one").iterdir()}
    theirs = {file.name: file.read_bytes() for file in (tmp_path / "run").iterdir()}
    assert ours.keys() == theirs.keys()
    same = {name for name in ours if ours[name] == theirs[name]}
    assert ours.keys() - same <= {"run.json", "timings.json", "report.html"}
    assert list(services.settings.work_folder.iterdir()) == []
